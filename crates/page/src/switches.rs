//! The panel of switches beside a page: HTML, style and scripts, for a live page and for one that
//! is sent. A live page gets its numbers from its server; a sent one computes them from numbers
//! that it carries (`sent`).

use crate::Live;
use crate::pack::deflated;
use serde_json::Value;

/// Style of the panel.
pub const STYLE: &str = include_str!("../templates/switches/switches.css");
/// Script of the panel; it needs a source of numbers after it.
pub const SCRIPT: &str =
    concat!(include_str!("../templates/switches/switches.js"), include_str!("../templates/switches/rung.js"));
/// Script that computes a model with any choice of effects from packed numbers.
pub const KERNEL: &str = include_str!("../templates/switches/kernel.js");

const PANEL: &str = include_str!("../templates/switches/panel.html");
const RESET: &str = "<button type=\"button\" id=\"studio-reset\" disabled>Back to the model</button>\n";
const ASK: &str = "<ul id=\"studio-list\">";
const END: &str = "</aside>";

/// The panel of a live page: other buttons, what follows the verdict, and parts at the end.
pub fn live_panel(actions: &str, ask: &str, more: &str) -> String {
    let (asked, ended) = (format!("{ask}{ASK}"), format!("{more}{END}"));
    PANEL.replacen(RESET, actions, 1).replacen(ASK, &asked, 1).replacen(END, &ended, 1)
}

/// A page's own switches: everything that its panel needs, as JSON.
#[derive(Debug, Clone, PartialEq)]
pub struct Sent {
    panel: String,
    script: String,
}

impl Sent {
    /// From the state of the results and the packed numbers (`offline.js` names the fields).
    pub fn new(numbers: &Value) -> Self {
        // base64 holds nothing that could end the script
        let text = deflated(&numbers.to_string());
        Self {
            panel: format!("{PANEL}<script type=\"text/plain\" id=\"switch-numbers\">{text}</script>\n"),
            script: [KERNEL, SCRIPT, include_str!("../templates/switches/offline.js")].concat(),
        }
    }

    /// As a panel of a page that talks to no server.
    pub fn panel(&self) -> Live<'_> {
        Live { panel: &self.panel, style: STYLE, script: &self.script, served: false }
    }
}
