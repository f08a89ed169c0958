//! One self-contained HTML page per run: text, tables, pictures, plots; no network, no scripts needed to read
//! it.

#![warn(unreachable_pub)]

pub mod plot;
pub mod preview;
pub mod scene;

use base64::Engine;
use dataset::Result;
use std::fmt::Write;
use std::path::Path;

/// Light or dark as the reader's system is; system fonts only.
const STYLE: &str = include_str!("style.css");

/// A page under construction.
#[derive(Debug)]
pub struct Report {
    title: String,
    /// What is seen first, before any heading.
    lead: Vec<Section>,
    sections: Vec<Section>,
}

/// A headed part of a page.
#[derive(Debug)]
pub struct Section {
    heading: String,
    html: String,
    is_folded: bool,
}

impl Report {
    /// An empty page.
    pub fn new(title: &str) -> Self {
        Report { title: title.to_owned(), lead: Vec::new(), sections: Vec::new() }
    }

    /// Appends what is seen first; its heading is not shown.
    pub fn lead(&mut self, section: Section) {
        self.lead.push(section);
    }

    /// Appends a section.
    pub fn push(&mut self, section: Section) {
        self.sections.push(section);
    }

    /// The page as HTML.
    pub fn to_html(&self) -> String {
        let title = escape(&self.title);
        let mut html = format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n<main>\n<h1>{title}</h1>\n"
        );
        for section in &self.lead {
            let _ = write!(html, "<section class=\"lead\">\n{}</section>\n", section.html);
        }
        // A table of contents, where there is something to choose.
        if self.sections.len() > 1 {
            html.push_str("<nav>");
            for (number, section) in self.sections.iter().enumerate() {
                let _ = write!(html, "<a href=\"#part-{}\">{}</a> ", number + 1, escape(&section.heading));
            }
            html.push_str("</nav>\n");
        }
        for (number, section) in self.sections.iter().enumerate() {
            let (id, heading) = (number + 1, escape(&section.heading));
            let heading = format!("<h2>{heading}</h2>\n");
            let content = match section.is_folded {
                true => format!(
                    "<details>\n<summary>{}</summary>\n{}</details>\n",
                    heading.trim_end(),
                    section.html
                ),
                false => heading + &section.html,
            };
            let _ = write!(html, "<section id=\"part-{id}\">\n{content}</section>\n");
        }
        html.push_str("</main>\n</body>\n</html>\n");
        html
    }

    /// Writes the page, atomically.
    pub fn write(&self, path: &Path) -> Result<()> {
        dataset::host::files::write_atomically(path, self.to_html().as_bytes())
    }
}

impl Section {
    /// An empty section with its heading. All text given to these methods is escaped.
    pub fn new(heading: &str) -> Self {
        Section { heading: heading.to_owned(), html: String::new(), is_folded: false }
    }

    /// The same, shown by its heading alone until a reader opens it.
    pub fn folded(self) -> Self {
        Section { is_folded: true, ..self }
    }

    /// A heading of a part within the section.
    pub fn subheading(&mut self, text: &str) -> &mut Self {
        let _ = writeln!(self.html, "<h3>{}</h3>", escape(text));
        self
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) -> &mut Self {
        let _ = writeln!(self.html, "<p>{}</p>", escape(text));
        self
    }

    /// A bulleted list.
    pub fn list(&mut self, items: &[String]) -> &mut Self {
        self.html.push_str("<ul>\n");
        for item in items {
            let _ = writeln!(self.html, "<li>{}</li>", escape(item));
        }
        self.html.push_str("</ul>\n");
        self
    }

    /// A table; under a header, cells that parse as numbers are right-aligned.
    pub fn table(&mut self, header: &[&str], rows: &[Vec<String>]) -> &mut Self {
        self.html.push_str("<div class=\"wide\"><table>\n");
        if !header.is_empty() {
            self.html.push_str("<thead><tr>");
            for cell in header {
                let _ = write!(self.html, "<th>{}</th>", escape(cell));
            }
            self.html.push_str("</tr></thead>\n");
        }
        self.html.push_str("<tbody>\n");
        for row in rows {
            self.html.push_str("<tr>");
            for cell in row {
                let is_number = !header.is_empty() && cell.trim().parse::<f64>().is_ok();
                let class = if is_number { " class=\"number\"" } else { "" };
                let _ = write!(self.html, "<td{class}>{}</td>", escape(cell));
            }
            self.html.push_str("</tr>\n");
        }
        self.html.push_str("</tbody></table></div>\n");
        self
    }

    /// Pictures side by side (wrapping), each a PNG with its caption.
    pub fn pictures(&mut self, pictures: &[(String, Vec<u8>)]) -> &mut Self {
        self.html.push_str("<div class=\"pictures\">\n");
        for (caption, png) in pictures {
            let data = base64::engine::general_purpose::STANDARD.encode(png);
            let caption = escape(caption);
            let _ = writeln!(
                self.html,
                "<figure><img alt=\"{caption}\" src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>"
            );
        }
        self.html.push_str("</div>\n");
        self
    }

    /// Lines of a summary, each a title and what it says.
    pub fn summary(&mut self, lines: &[(&str, String)]) -> &mut Self {
        self.html.push_str("<dl>\n");
        for (title, text) in lines {
            let _ = writeln!(self.html, "<dt>{}</dt><dd>{}</dd>", escape(title), escape(text));
        }
        self.html.push_str("</dl>\n");
        self
    }

    /// Pictures in a row, as wide as the page, each a stack of PNGs with its caption. More than four stand in
    /// rows of three.
    pub fn row(&mut self, stacks: &[(String, Vec<Vec<u8>>)]) -> &mut Self {
        let class = if stacks.len() > 4 { "row many" } else { "row" };
        let _ = writeln!(self.html, "<div class=\"{class}\">");
        for (caption, pngs) in stacks {
            let caption = escape(caption);
            self.html.push_str("<figure>");
            for png in pngs {
                let data = base64::engine::general_purpose::STANDARD.encode(png);
                let _ = write!(self.html, "<img alt=\"{caption}\" src=\"data:image/png;base64,{data}\">");
            }
            let _ = writeln!(self.html, "<figcaption>{caption}</figcaption></figure>");
        }
        self.html.push_str("</div>\n");
        self
    }

    /// A plot.
    pub fn plot(&mut self, plot: &plot::Plot) -> &mut Self {
        let _ = writeln!(self.html, "<figure class=\"plot\">{}</figure>", plot.to_svg());
        self
    }
}

/// Text escaped for HTML, also for attributes.
fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_text_is_escaped_and_the_page_needs_no_network() {
        let evil = "<script>\"&'";
        let mut section = Section::new(evil);
        section
            .subheading(evil)
            .paragraph(evil)
            .list(&[evil.into()])
            .table(&[evil], &[vec![evil.into(), "1.5".into()]])
            .pictures(&[(evil.into(), vec![1, 2, 3])])
            .row(&[(evil.into(), vec![vec![1, 2, 3]])])
            .summary(&[(evil, evil.into())])
            .plot(&plot::Plot {
                title: evil.into(),
                x: evil.into(),
                y: evil.into(),
                log_x: false,
                log_y: true,
                lines: vec![(evil.into(), vec![(0.0, 1.0), (1.0, 10.0)])],
            });
        let mut report = Report::new(evil);
        report.push(section.folded());
        let mut lead = Section::new(evil);
        lead.row(&[(evil.into(), vec![vec![4, 5, 6]])]);
        report.lead(lead);
        let html = report.to_html();
        assert!(!html.contains("<script"), "{html}");
        // What leads comes first, and a folded section is opened by its heading.
        let place = |what: &str| html.find(what).unwrap_or_else(|| panic!("no {what} in {html}"));
        assert!(place("base64,BAUG") < place("<details>") && place("<details>") < place("<summary><h2>"));
        assert!(
            place("</h2></summary>") < place("base64,AQID") && place("base64,AQID") < place("</details>")
        );
        assert!(html.contains("<td class=\"number\">1.5</td>"));
        assert!(html.contains("data:image/png;base64,AQID"));
        // The only address is the name of the SVG standard.
        assert_eq!(html.replace("http://www.w3.org/2000/svg", "").matches("http").count(), 0);
    }
}
