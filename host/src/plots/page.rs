//! A self-contained HTML page around plots.

use super::phases;

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:940px;margin:2em auto;padding:0 1em;color:#222}\
h1{font-size:1.6em}h2{font-size:1.2em;margin-top:2em}pre{background:#f6f6f4;padding:1em;overflow-x:auto;font-size:13px;line-height:1.35}\
table{border-collapse:collapse;font-size:13px;display:block;overflow-x:auto}td,th{padding:.15em .6em;border-bottom:1px solid #ddd;text-align:left;white-space:nowrap}\
svg{max-width:100%;height:auto}.row{display:flex;flex-wrap:wrap}.row div{width:50%}\
h3{font-size:1em;margin:.5em 0 0}.key span{display:inline-block;padding:0 .6em;margin-right:.4em;border-radius:3px}\
.bad{color:#a00;font-weight:bold}.good{color:#060;font-weight:bold}";

/// The page; `body` is HTML.
pub(crate) fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>{}</title><style>{STYLE}</style></head>\
         <body>{body}</body></html>\n",
        escape(title)
    )
}

/// Key to the colours behind a plot over time.
pub(crate) fn key() -> String {
    let span = |(name, colour)| format!("<span style=\"background:{colour}\">{name}</span>");
    let spans: String = phases::key().map(span).collect();
    format!("<p class=\"key\">{spans}</p>")
}

/// Escapes text for HTML.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
