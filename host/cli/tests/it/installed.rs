//! Parts of an installation beside the program: completions, manual pages; and the detail
//! of the log.

use crate::process::Folder;

#[test]
fn every_shell_has_completions_of_all_commands() {
    let folder = Folder::new("completions");
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = folder.run(&["completions", shell]).success();
        for words in ["gantry-tau", "labcomm", "overwrite", "geometry"] {
            assert!(script.contains(words), "{shell}: {words}");
        }
    }
    let line = folder.run(&["completions", "cmd"]).failure(2);
    assert!(line.contains("invalid value 'cmd'"), "{line}");
}

/// The script is one that the shell can read, and completes commands and their options.
#[cfg(unix)]
#[test]
fn bash_completes_an_option() {
    let Ok(bash) = std::process::Command::new("bash").arg("--version").output() else {
        return;
    };
    assert!(bash.status.success());
    let folder = Folder::new("completions_bash");
    folder.write("script", &folder.run(&["completions", "bash"]).success());
    for (words, completed) in [
        ("gantry-tau mon", "monitor"),
        ("gantry-tau serve --first", "--first-run"),
        ("gantry-tau plan sp", "springs"),
        ("gantry-tau plan springs --ro", "--robot"),
    ] {
        // The function gets the name, the word under the cursor, and the word before it.
        let call = format!(
            "source ./script; COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); \
             _gantry__tau gantry-tau \"${{COMP_WORDS[-1]}}\" \"${{COMP_WORDS[-2]}}\"; \
             echo \"${{COMPREPLY[@]}}\""
        );
        let said = std::process::Command::new("bash")
            .args(["-c", &call])
            .current_dir(folder.path("."))
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&said.stdout).into_owned();
        assert_eq!(said.trim(), completed, "{words}");
    }
}

#[test]
fn every_command_has_a_manual_page() {
    let folder = Folder::new("man");
    folder.write("gantry-tau-demo.1", "");
    let said = folder.run(&["man", "pages/man1"]).success();
    assert!(said.starts_with("pages/man1: "), "{said}");
    let main = folder.read("pages/man1/gantry-tau.1");
    assert!(main.contains(".TH gantry-tau 1"), "{main}");
    for page in [
        "serve",
        "plan-springs",
        "robot-check",
        "labcomm-decode",
        "completions",
        "man",
    ] {
        let text = folder.read(&format!("pages/man1/gantry-tau-{page}.1"));
        assert!(
            text.contains(".SH NAME") && text.contains(".SH SYNOPSIS"),
            "{text}"
        );
    }
    // Written again over its own pages, and never over a file of somebody else.
    folder.run(&["man", "pages/man1"]).success();
    folder.write("pages/man1/gantry-tau-serve.1", "my notes\n");
    let line = folder.run(&["man", "pages/man1"]).failure(1);
    assert!(
        line.contains("is not a manual page of gantry-tau"),
        "{line}"
    );
    assert_eq!(folder.read("pages/man1/gantry-tau-serve.1"), "my notes\n");
}

#[test]
fn the_log_has_the_wanted_detail() {
    let folder = Folder::new("verbosity");
    let draw = ["draw", "--robot", "l2", "-v"];
    let said = folder.run(&draw).stderr;
    assert!(
        said.contains("robots/l2.toml (built in): l2, kinematics "),
        "{said}"
    );
    assert_eq!(folder.run(&draw[..3]).stderr, "");
    // Before and behind the command; one takes away the other.
    let said = folder.run(&["-v", "draw", "--robot", "l2", "-q"]).stderr;
    assert_eq!(said, "");
}
