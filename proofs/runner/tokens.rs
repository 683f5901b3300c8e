//! Tokens of a source file in a normal form, in which rustfmt's settings make no difference.
//!
//! The following do not count; every other difference between two files does:
//! - comments and doc comments, blank lines, line breaks, and indentation;
//! - a comma before the end of a list, and after the arm of a `match`; the comma of a tuple with
//!   one element counts;
//! - braces around the single expression of a closure or of an arm;
//! - the semicolon after a `return`, `break` or `continue` that ends a block;
//! - modules in files of their own, modules of tests, and entries `FAMILY::HARNESSES` of an array.
//!
//! The arguments of a macro are read as expressions where the macro is known to take expressions
//! ([`OF_EXPRESSIONS`]). Every other macro may tell any two tokens apart, so all its tokens count,
//! but for doc comments.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::{Mutex, PoisonError};

use proc_macro2::{Delimiter, Group, Spacing, TokenStream, TokenTree};
use quote::ToTokens;
use syn::visit_mut::{self, VisitMut};
use syn::{Expr, Item, ReturnType, Stmt};

#[cfg(test)]
mod tests;

/// Program of one source file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Program {
    /// Tokens in the normal form, separated by spaces; the characters of an operator stand
    /// together.
    pub(crate) text: String,
    /// Modules in files of their own.
    pub(crate) modules: Vec<Module>,
}

/// Declaration of a module in a file of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Module {
    pub(crate) name: String,
    /// Contents of its attributes, as tokens.
    attributes: Vec<String>,
}

impl Module {
    /// True for a module that only tests have.
    pub(crate) fn is_test(&self) -> bool {
        self.has("cfg ( test )")
    }

    /// True for a module that is compiled with a feature only.
    pub(crate) fn is_behind(&self, feature: &str) -> bool {
        self.has(&format!("cfg ( feature = \"{feature}\" )"))
    }

    fn has(&self, attribute: &str) -> bool {
        self.attributes.iter().any(|own| own == attribute)
    }
}

/// Programs by the text of their files: a run asks for the same files many times.
static KNOWN: Mutex<BTreeMap<String, Program>> = Mutex::new(BTreeMap::new());

/// Program of a source file, or the parser's objection.
pub(crate) fn program(source: &str) -> Result<Program, String> {
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(program) = known.get(source) {
        return Ok(program.clone());
    }
    let program = parse(source)?;
    known.insert(source.to_owned(), program.clone());
    Ok(program)
}

fn parse(source: &str) -> Result<Program, String> {
    let mut file = syn::parse_file(source).map_err(|error| format!("does not parse: {error}"))?;
    let mut modules = Vec::new();
    file.items.retain(|item| {
        let Item::Mod(item) = item else { return true };
        let attributes = item
            .attrs
            .iter()
            .map(|attribute| text(attribute.meta.to_token_stream()));
        let module = Module {
            name: item.ident.to_string(),
            attributes: attributes.collect(),
        };
        let counts = item.content.is_some() && !module.is_test();
        if item.content.is_none() {
            modules.push(module);
        }
        counts
    });
    NormalForm.visit_file_mut(&mut file);
    Ok(Program {
        text: text(file.into_token_stream()),
        modules,
    })
}

/// Macros that take expressions and nothing else, and to which a comma after the last one means
/// nothing. (The pattern of a `matches!` reads as an expression too, or the arguments stay as they
/// are.)
const OF_EXPRESSIONS: [&str; 22] = [
    "assert",
    "assert_eq",
    "assert_ne",
    "assume",
    "cover",
    "debug_assert",
    "debug_assert_eq",
    "debug_assert_ne",
    "eprint",
    "eprintln",
    "format",
    "format_args",
    "matches",
    "panic",
    "print",
    "println",
    "todo",
    "unimplemented",
    "unreachable",
    "vec",
    "write",
    "writeln",
];

/// Brings a syntax tree into the normal form.
struct NormalForm;

/// Methods that drop the comma after the last element of a list, which means nothing there.
macro_rules! drop_last_comma {
    ($($method:ident: $node:ident, $list:ident;)*) => {$(
        fn $method(&mut self, node: &mut syn::$node) {
            node.$list.pop_punct();
            visit_mut::$method(self, node);
        }
    )*};
}

/// Methods that do so for tuples, where the comma after a single element makes the tuple.
macro_rules! drop_last_comma_of_several {
    ($($method:ident: $node:ident;)*) => {$(
        fn $method(&mut self, node: &mut syn::$node) {
            if node.elems.len() > 1 {
                node.elems.pop_punct();
            }
            visit_mut::$method(self, node);
        }
    )*};
}

impl VisitMut for NormalForm {
    drop_last_comma! {
        visit_angle_bracketed_generic_arguments_mut: AngleBracketedGenericArguments, args;
        visit_bound_lifetimes_mut: BoundLifetimes, lifetimes;
        visit_expr_call_mut: ExprCall, args;
        visit_expr_method_call_mut: ExprMethodCall, args;
        visit_expr_struct_mut: ExprStruct, fields;
        visit_fields_named_mut: FieldsNamed, named;
        visit_fields_unnamed_mut: FieldsUnnamed, unnamed;
        visit_generics_mut: Generics, params;
        visit_item_enum_mut: ItemEnum, variants;
        visit_parenthesized_generic_arguments_mut: ParenthesizedGenericArguments, inputs;
        visit_pat_slice_mut: PatSlice, elems;
        visit_pat_struct_mut: PatStruct, fields;
        visit_pat_tuple_struct_mut: PatTupleStruct, elems;
        visit_precise_capture_mut: PreciseCapture, params;
        visit_signature_mut: Signature, inputs;
        visit_type_fn_ptr_mut: TypeFnPtr, inputs;
        visit_use_group_mut: UseGroup, items;
        visit_where_clause_mut: WhereClause, predicates;
    }

    drop_last_comma_of_several! {
        visit_expr_tuple_mut: ExprTuple;
        visit_pat_tuple_mut: PatTuple;
        visit_type_tuple_mut: TypeTuple;
    }

    fn visit_expr_array_mut(&mut self, node: &mut syn::ExprArray) {
        node.elems.retain(|element| !is_list_of_a_family(element));
        node.elems.pop_punct();
        visit_mut::visit_expr_array_mut(self, node);
    }

    fn visit_arm_mut(&mut self, node: &mut syn::Arm) {
        visit_mut::visit_arm_mut(self, node);
        drop_braces(&mut node.body);
        node.comma = Some(Default::default());
    }

    fn visit_expr_closure_mut(&mut self, node: &mut syn::ExprClosure) {
        node.inputs.pop_punct();
        visit_mut::visit_expr_closure_mut(self, node);
        // After a type the braces are needed.
        if matches!(node.output, ReturnType::Default) {
            drop_braces(&mut node.body);
        }
    }

    fn visit_block_mut(&mut self, node: &mut syn::Block) {
        visit_mut::visit_block_mut(self, node);
        if let Some(Stmt::Expr(Expr::Return(_) | Expr::Break(_) | Expr::Continue(_), semicolon)) =
            node.stmts.last_mut()
        {
            *semicolon = None;
        }
    }

    fn visit_meta_list_mut(&mut self, node: &mut syn::MetaList) {
        node.tokens = without_last_commas(node.tokens.clone(), true);
    }

    fn visit_macro_mut(&mut self, node: &mut syn::Macro) {
        let name = node
            .path
            .segments
            .last()
            .map(|last| last.ident.to_string())
            .unwrap_or_default();
        if name == "macro_rules" {
            node.tokens = rules(node.tokens.clone());
        } else if OF_EXPRESSIONS.contains(&name.as_str()) {
            node.tokens = expressions(node.tokens.clone());
        }
    }
}

/// True for an entry such as `axis::HARNESSES`.
fn is_list_of_a_family(element: &Expr) -> bool {
    let Expr::Path(path) = element else {
        return false;
    };
    path.path.segments.len() > 1
        && path
            .path
            .segments
            .last()
            .is_some_and(|last| last.ident == "HARNESSES")
}

/// Replaces a block that is nothing but an expression by that expression. Blocks with a label or
/// attributes stay, and so do those of an expression with attributes.
fn drop_braces(body: &mut Expr) {
    while let Some(expression) = single_expression(body) {
        *body = expression;
    }
}

fn single_expression(body: &Expr) -> Option<Expr> {
    let Expr::Block(node) = body else { return None };
    let [statement] = node.block.stmts.as_slice() else {
        return None;
    };
    if !node.attrs.is_empty() || node.label.is_some() {
        return None;
    }
    match statement {
        Stmt::Expr(expression, None) if !has_attributes(expression) => Some(expression.clone()),
        Stmt::Macro(call) if call.attrs.is_empty() && call.semi_token.is_none() => {
            Some(Expr::Macro(syn::ExprMacro {
                attrs: Vec::new(),
                mac: call.mac.clone(),
            }))
        }
        _ => None,
    }
}

fn has_attributes(expression: &Expr) -> bool {
    let first = expression.to_token_stream().into_iter().next();
    matches!(first, Some(TokenTree::Punct(punct)) if punct.as_char() == '#')
}

/// Arguments of a macro that takes expressions, in the normal form; as they are where they are
/// something else, such as a pattern with a guard.
fn expressions(arguments: TokenStream) -> TokenStream {
    // What a macro takes stands in an array too: a list, or `value; count`.
    let array = TokenTree::from(Group::new(Delimiter::Bracket, arguments.clone()));
    let Ok(mut array) = syn::parse2::<Expr>(array.into()) else {
        return arguments;
    };
    NormalForm.visit_expr_mut(&mut array);
    match array.to_token_stream().into_iter().next() {
        Some(TokenTree::Group(group)) => group.stream(),
        _ => arguments,
    }
}

/// Body of a `macro_rules!`: each pattern as it is, each expansion without last commas.
fn rules(body: TokenStream) -> TokenStream {
    let mut before = [None, None];
    let rules = body.into_iter().map(|tree| {
        let is_expansion = before == [Some('='), Some('>')];
        before = [
            before[1],
            if let TokenTree::Punct(punct) = &tree {
                Some(punct.as_char())
            } else {
                None
            },
        ];
        match tree {
            TokenTree::Group(group) if is_expansion => {
                let has_items = group.delimiter() != Delimiter::Parenthesis;
                Group::new(
                    group.delimiter(),
                    without_last_commas(group.stream(), has_items),
                )
                .into()
            }
            tree => tree,
        }
    });
    rules.collect()
}

/// Words after which parentheses are not those of a call.
const NOT_CALLED: [&str; 16] = [
    "as", "box", "break", "const", "else", "for", "if", "in", "let", "match", "move", "mut", "pub",
    "ref", "return", "while",
];

/// Tokens without the last comma of a list, where it certainly means nothing: in brackets, in
/// braces, and in the parentheses of a call. The arguments of a macro, `$( )` and tuples stay as
/// they are.
fn without_last_commas(tokens: TokenStream, is_list: bool) -> TokenStream {
    let mut trees: Vec<TokenTree> = Vec::new();
    for tree in tokens {
        let tree = match tree {
            TokenTree::Group(group) if !is_macro_call(&trees) => {
                let is_list = match group.delimiter() {
                    Delimiter::Bracket | Delimiter::Brace => {
                        !matches!(trees.last(), Some(tree) if is_punct(tree, '$'))
                    }
                    Delimiter::Parenthesis => is_called(&trees),
                    Delimiter::None => false,
                };
                Group::new(
                    group.delimiter(),
                    without_last_commas(group.stream(), is_list),
                )
                .into()
            }
            tree => tree,
        };
        trees.push(tree);
    }
    if is_list && trees.last().is_some_and(|last| is_punct(last, ',')) {
        trees.pop();
    }
    trees.into_iter().collect()
}

/// True if these tokens end with `name!`, or with `macro_rules! name`.
fn is_macro_call(before: &[TokenTree]) -> bool {
    match before {
        [.., TokenTree::Ident(_), bang] | [.., TokenTree::Ident(_), bang, TokenTree::Ident(_)] => {
            is_punct(bang, '!')
        }
        _ => false,
    }
}

/// True if these tokens end with the name of a function.
fn is_called(before: &[TokenTree]) -> bool {
    match before {
        // A lifetime, or a variable of a macro, which may be anything.
        [.., sign, TokenTree::Ident(_)] if is_punct(sign, '\'') || is_punct(sign, '$') => false,
        [.., TokenTree::Ident(name)] => !NOT_CALLED.contains(&name.to_string().as_str()),
        _ => false,
    }
}

fn is_punct(tree: &TokenTree, character: char) -> bool {
    matches!(tree, TokenTree::Punct(punct) if punct.as_char() == character)
}

/// Text of tokens, without doc comments.
fn text(tokens: TokenStream) -> String {
    let mut text = String::new();
    append(&mut text, tokens);
    text.trim_end().to_owned()
}

fn append(text: &mut String, tokens: TokenStream) {
    let trees = Vec::from_iter(tokens);
    let mut rest = trees.as_slice();
    while let Some((tree, after)) = rest.split_first() {
        if let Some(after) = after_doc_comment(rest) {
            rest = after;
            continue;
        }
        rest = after;
        // Writing to a String cannot fail.
        let _ = match tree {
            TokenTree::Group(group) => {
                let (open, close) = match group.delimiter() {
                    Delimiter::Parenthesis => ("( ", ") "),
                    Delimiter::Brace => ("{ ", "} "),
                    Delimiter::Bracket => ("[ ", "] "),
                    Delimiter::None => ("", ""),
                };
                text.push_str(open);
                append(text, group.stream());
                text.write_str(close)
            }
            TokenTree::Punct(punct) if punct.spacing() == Spacing::Joint => {
                text.write_char(punct.as_char())
            }
            _ => write!(text, "{tree} "),
        };
    }
}

/// What follows a doc comment, which is an attribute by now; `None` if the tokens do not begin with
/// one.
fn after_doc_comment(trees: &[TokenTree]) -> Option<&[TokenTree]> {
    let (group, after) = match trees {
        [hash, TokenTree::Group(group), after @ ..] if is_punct(hash, '#') => (group, after),
        [hash, bang, TokenTree::Group(group), after @ ..]
            if is_punct(hash, '#') && is_punct(bang, '!') =>
        {
            (group, after)
        }
        _ => return None,
    };
    match Vec::from_iter(group.stream()).as_slice() {
        [TokenTree::Ident(doc), equals, TokenTree::Literal(_)]
            if doc == "doc" && is_punct(equals, '=') =>
        {
            Some(after)
        }
        _ => None,
    }
}
