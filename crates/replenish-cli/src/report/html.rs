//! A self-contained HTML page: no scripts, no fonts, no files beside it.

use super::table::{Table, is_number};

/// A wide figure or table scrolls by itself, so that the page fits on a phone.
const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1c2733;--paper:#fff;--soft:#52606d;--line:#e4e7eb;--head:#9aa5b1;\
--box:#f2f6fb;--edge:#2563a8;--warn:#fdf6ec;--warnedge:#b45309;--code:#f0f2f5}\
@media(prefers-color-scheme:dark){:root{--ink:#e6e9ed;--paper:#14191f;--soft:#a9b4bf;--line:#2a333d;--head:#5b6876;\
--box:#1b2836;--edge:#5b9be0;--warn:#2e2415;--warnedge:#d98a2b;--code:#232c36}}\
body{font:16px/1.55 system-ui,sans-serif;max-width:62rem;margin:2.5rem auto;padding:0 1.2rem;color:var(--ink);background:var(--paper)}\
h1{font-size:1.7rem;line-height:1.25;margin-bottom:.2rem}h2{font-size:1.15rem;margin-top:2.2rem}\
.lead{color:var(--soft);margin-top:0}.answer{border-left:4px solid var(--edge);background:var(--box);padding:.7rem 1rem}\
.warning{border-left-color:var(--warnedge);background:var(--warn)}\
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:.92rem;margin:.8rem 0}\
th{text-align:left;border-bottom:2px solid var(--head)}\
th,td{padding:.28rem .9rem .28rem 0;vertical-align:bottom}td{border-bottom:1px solid var(--line)}\
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}td.n{white-space:nowrap}\
figure{margin:1rem 0}figure svg{width:100%;min-width:40rem;height:auto}figcaption{color:var(--soft);font-size:.9rem}\
code{background:var(--code);padding:.1em .3em;border-radius:3px;font-size:.9em}footer{color:var(--soft);font-size:.85rem;margin-top:3rem}";

/// A page under construction.
#[derive(Debug)]
pub struct Page {
    title: String,
    body: String,
}

impl Page {
    /// A page with a heading and a line that says what it is about.
    pub fn new(title: &str, lead: &str) -> Self {
        let body = format!(
            "<h1>{}</h1>\n<p class=\"lead\">{}</p>\n",
            escape(title),
            inline(lead)
        );
        Self {
            title: title.to_string(),
            body,
        }
    }

    /// A section heading.
    pub fn heading(&mut self, text: &str) {
        self.body.push_str(&format!("<h2>{}</h2>\n", escape(text)));
    }

    /// A paragraph of plain text.
    pub fn text(&mut self, text: &str) {
        self.body.push_str(&format!("<p>{}</p>\n", inline(text)));
    }

    /// The sentence that a hurried reader wants.
    pub fn answer(&mut self, text: &str) {
        self.body
            .push_str(&format!("<p class=\"answer\">{}</p>\n", escape(text)));
    }

    /// Something that limits what the page says.
    pub fn warning(&mut self, text: &str) {
        self.body.push_str(&format!(
            "<p class=\"answer warning\">{}</p>\n",
            inline(text)
        ));
    }

    /// A table; number columns are aligned to the right.
    pub fn table(&mut self, table: &Table) {
        let Some((head, rows)) = table.rows().split_first() else {
            return;
        };
        let numeric: Vec<bool> = (0..head.len())
            .map(|c| {
                rows.iter()
                    .filter_map(|r| r.get(c))
                    .all(|cell| is_number(cell))
            })
            .collect();
        let line = |cells: &[String], tag: &str| {
            let cells: String = cells
                .iter()
                .zip(&numeric)
                .map(|(cell, n)| {
                    let class = if *n { " class=\"n\"" } else { "" };
                    format!("<{tag}{class}>{}</{tag}>", escape(cell))
                })
                .collect();
            format!("<tr>{cells}</tr>\n")
        };
        self.body.push_str("<div class=\"wide\"><table>\n");
        self.body.push_str(&line(head, "th"));
        for row in rows {
            self.body.push_str(&line(row, "td"));
        }
        self.body.push_str("</table></div>\n");
    }

    /// A figure: SVG text as it is, and a caption.
    pub fn figure(&mut self, svg: &str, caption: &str) {
        self.body.push_str(&format!(
            "<figure>\n<div class=\"wide\">{svg}</div>\n<figcaption>{}</figcaption></figure>\n",
            inline(caption)
        ));
    }

    /// A list of a term and its explanation per line.
    pub fn glossary(&mut self, terms: &[(&str, &str)]) {
        self.body.push_str("<dl>\n");
        for (term, meaning) in terms {
            let (term, meaning) = (escape(term), inline(meaning));
            self.body
                .push_str(&format!("<dt><b>{term}</b></dt><dd>{meaning}</dd>\n"));
        }
        self.body.push_str("</dl>\n");
    }

    /// The finished page; `footer` says how it was made.
    pub fn finish(self, footer: &str) -> String {
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
             <title>{}</title>\n<style>{STYLE}</style></head>\n<body>\n{}<footer>{}</footer>\n\
             </body></html>\n",
            escape(&self.title),
            self.body,
            escape(footer)
        )
    }
}

/// Text with `code` between backticks.
fn inline(text: &str) -> String {
    let mut html = String::new();
    for (n, part) in escape(text).split('`').enumerate() {
        match n % 2 {
            0 => html.push_str(part),
            _ => html.push_str(&format!("<code>{part}</code>")),
        }
    }
    html
}

/// Text that is safe between tags and in attributes.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_cannot_become_markup() {
        let mut page = Page::new("a < b", "x & y");
        page.text("<script> and `code`");
        let html = page.finish("");
        assert!(html.contains("a &lt; b") && html.contains("&lt;script&gt;"));
        assert!(!html.contains("<script>") && html.contains("<code>code</code>"));
    }

    #[test]
    fn a_page_fits_a_phone_and_a_dark_screen() {
        let mut page = Page::new("t", "");
        let mut table = Table::new(&["a"]);
        table.row(["1"]);
        page.table(&table);
        page.figure("<svg></svg>", "");
        let html = page.finish("");
        assert!(html.contains("width=device-width,initial-scale=1"));
        assert!(html.contains("prefers-color-scheme:dark"));
        assert_eq!(html.matches("<div class=\"wide\">").count(), 2);
        assert_eq!(html.matches("<div").count(), html.matches("</div>").count());
        // Each colour outside of the two lists is one of them.
        let rules = STYLE.split("body{").nth(1).unwrap();
        assert!(!rules.contains('#'), "{rules}");
    }
}
