//! XML writer that writes elements in order and closes them in order.

/// A document being written.
#[derive(Debug)]
pub(crate) struct Xml {
    text: String,
    open: Vec<String>,
}

/// Text with the five reserved characters of XML escaped.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&apos;"),
            // not allowed in XML
            c if c.is_control() && !matches!(c, '\t' | '\n' | '\r') => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

impl Xml {
    pub fn new() -> Self {
        Self { text: "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n".to_owned(), open: Vec::new() }
    }

    fn indent(&mut self) {
        for _ in 0..self.open.len() {
            self.text.push_str("  ");
        }
    }

    fn tag(&mut self, name: &str, attributes: &[(&str, &str)]) {
        self.indent();
        self.text.push('<');
        self.text.push_str(name);
        for (key, value) in attributes {
            self.text.push_str(&format!(" {key}=\"{}\"", escaped(value)));
        }
    }

    /// Opens an element.
    pub fn open(&mut self, name: &str, attributes: &[(&str, &str)]) -> &mut Self {
        self.tag(name, attributes);
        self.text.push_str(">\n");
        self.open.push(name.to_owned());
        self
    }

    /// Closes the innermost open element.
    pub fn close(&mut self) -> &mut Self {
        if let Some(name) = self.open.pop() {
            self.indent();
            self.text.push_str(&format!("</{name}>\n"));
        }
        self
    }

    /// An element without content.
    pub fn empty(&mut self, name: &str, attributes: &[(&str, &str)]) -> &mut Self {
        self.tag(name, attributes);
        self.text.push_str("/>\n");
        self
    }

    /// An element that holds text.
    pub fn leaf(&mut self, name: &str, content: &str) -> &mut Self {
        self.indent();
        self.text.push_str(&format!("<{name}>{}</{name}>\n", escaped(content)));
        self
    }

    /// A comment for human readers.
    pub fn comment(&mut self, text: &str) -> &mut Self {
        self.indent();
        let mut text = text.to_owned();
        while text.contains("--") {
            text = text.replace("--", "-");
        }
        self.text.push_str(&format!("<!-- {text} -->\n"));
        self
    }

    /// The bytes of the document; open elements are closed.
    pub fn finish(mut self) -> Vec<u8> {
        while !self.open.is_empty() {
            self.close();
        }
        self.text.into_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_elements_nest_and_text_is_escaped() {
        let mut x = Xml::new();
        x.open("a", &[("name", "L&R")]).leaf("b", "1 < 2").empty("c", &[]).comment("x -- y");
        let text = String::from_utf8(x.finish()).unwrap();
        assert_eq!(
            text,
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<a name=\"L&amp;R\">\n  <b>1 &lt; 2</b>\n  <c/>\n  <!-- x - y -->\n</a>\n"
        );
    }
}
