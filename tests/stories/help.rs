//! Help texts: examples for every command, the manual page, shell completions.

use crate::support::expect;

fn commands() -> Vec<String> {
    let (help, _) = expect(&["--help"], 0);
    let from = help.find("Commands:").unwrap();
    help[from..]
        .lines()
        .skip(1)
        .take_while(|l| !l.trim().is_empty())
        .filter(|l| l.starts_with("  ") && !l.starts_with("   "))
        .filter_map(|l| l.split_whitespace().next().map(str::to_owned))
        .filter(|c| c != "help")
        .collect()
}

#[test]
fn every_command_shows_examples() {
    let commands = commands();
    assert!(commands.len() > 12, "{commands:?}");
    for command in &commands {
        let (help, _) = expect(&[command, "--help"], 0);
        assert!(help.contains("Examples:") && help.contains(&format!("aloft {command}")), "{command}:\n{help}");
    }
}

#[test]
fn the_manual_page_and_completions_name_every_command() {
    let (page, _) = expect(&["man"], 0);
    let shells = ["bash", "zsh", "fish", "powershell", "elvish"].map(|s| expect(&["completions", s], 0).0);
    for command in commands() {
        assert!(page.contains(&command), "the manual page lacks {command}");
        for text in &shells {
            assert!(text.contains(&command), "a completion lacks {command}");
        }
    }
}
