//! Lines of styled text, and what they become: a terminal's escapes, plain text, or a picture.

use std::fmt::Write;

/// The look of a piece of text. Colours are left out with `NO_COLOR`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Style {
    #[default]
    Plain,
    /// Headings.
    Bold,
    /// The line that is selected.
    Selected,
    /// As it should be.
    Good,
    /// Worth a look.
    Warn,
    /// Wrong.
    Bad,
    /// Less important.
    Dim,
}

/// A line.
#[derive(Debug, Clone, Default)]
pub(super) struct Line {
    spans: Vec<(Style, String)>,
}

impl Line {
    pub(super) fn of(style: Style, text: impl Into<String>) -> Self {
        let mut line = Self::default();
        line.add(style, text);
        line
    }

    pub(super) fn add(&mut self, style: Style, text: impl Into<String>) {
        self.spans.push((style, text.into()));
    }

    /// All of it in one style.
    pub(super) fn all(&mut self, style: Style) {
        self.spans.iter_mut().for_each(|(old, _)| *old = style);
    }

    #[cfg(test)]
    pub(super) fn width(&self) -> usize {
        self.spans
            .iter()
            .map(|(_, text)| text.chars().count())
            .sum()
    }

    /// Without what lies beyond `width`; with a style, filled up to it.
    pub(super) fn fit(mut self, width: usize, fill: Option<Style>) -> Self {
        let mut room = width;
        for (_, text) in &mut self.spans {
            *text = text.chars().take(room).map(shown).collect();
            room -= text.chars().count();
        }
        if let Some(style) = fill {
            self.add(style, " ".repeat(room));
        }
        self
    }

    #[cfg(test)]
    pub(super) fn plain(&self) -> String {
        let text: String = self.spans.iter().map(|(_, text)| text.as_str()).collect();
        text.trim_end().into()
    }
}

/// Names are other people's: no letter moves the cursor or turns the line around.
fn shown(c: char) -> char {
    let drawn = c.is_alphanumeric()
        || matches!(
            c,
            ' '..='~' | '█' | '▓' | '░' | '·' | '─' | '│' | '▕' | '▏' | '…' | '↵'
        );
    if drawn { c } else { '?' }
}

/// For a terminal: the cursor goes home, each line is written over the one that was there.
pub(super) fn to_terminal(lines: &[Line], colours: bool) -> String {
    let mut out = String::from("\x1b[H");
    for (n, line) in lines.iter().enumerate() {
        if n > 0 {
            out.push_str("\r\n");
        }
        for (style, text) in &line.spans {
            let code = match style {
                Style::Plain => "",
                Style::Bold => "1",
                Style::Selected => "7",
                Style::Good if colours => "32",
                Style::Warn if colours => "33",
                Style::Bad if colours => "31",
                Style::Dim if colours => "90",
                _ => "",
            };
            if code.is_empty() {
                out.push_str(text);
            } else {
                write!(out, "\x1b[{code}m{text}\x1b[0m").ok();
            }
        }
        out.push_str("\x1b[K");
    }
    out.push_str("\x1b[J");
    out
}

/// A picture of the terminal, `width` columns wide.
pub(super) fn to_svg(lines: &[Line], width: usize) -> String {
    const CELL: (f64, f64) = (8.4, 18.0);
    let (w, h) = (
        width as f64 * CELL.0 + 24.0,
        lines.len() as f64 * CELL.1 + 24.0,
    );
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w:.0} {h:.0}\" width=\"{w:.0}\" \
         height=\"{h:.0}\" font-family=\"ui-monospace, Menlo, Consolas, monospace\" \
         font-size=\"14\">\n<rect width=\"100%\" height=\"100%\" rx=\"8\" fill=\"#16181d\"/>\n"
    );
    for (row, line) in lines.iter().enumerate() {
        let top = 12.0 + row as f64 * CELL.1;
        let mut column = 0;
        for (style, text) in &line.spans {
            let (count, x) = (text.chars().count(), 12.0 + column as f64 * CELL.0);
            column += count;
            let (colour, more) = match style {
                Style::Plain => ("#d7dae0", ""),
                Style::Bold => ("#ffffff", " font-weight=\"bold\""),
                Style::Selected => ("#16181d", ""),
                Style::Good => ("#7ec699", ""),
                Style::Warn => ("#e8bf6a", ""),
                Style::Bad => ("#f2777a", ""),
                Style::Dim => ("#7a8290", ""),
            };
            let wide = count as f64 * CELL.0;
            if *style == Style::Selected {
                writeln!(out, "<rect x=\"{x:.1}\" y=\"{top:.1}\" width=\"{wide:.1}\" height=\"{}\" fill=\"#d7dae0\"/>", CELL.1).ok();
            }
            if !text.trim().is_empty() {
                let text = text.replace('&', "&amp;").replace('<', "&lt;");
                writeln!(out, "<text x=\"{x:.1}\" y=\"{:.1}\" textLength=\"{wide:.1}\" xml:space=\"preserve\" fill=\"{colour}\"{more}>{text}</text>", top + 14.0).ok();
            }
        }
    }
    out.push_str("</svg>\n");
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_cut_filled_and_harmless() {
        let mut line = Line::of(Style::Good, "ab\u{202e}c");
        line.add(Style::Plain, "defgh\x1b");
        let fit = line.clone().fit(6, None);
        assert_eq!(fit.plain(), "ab?cde");
        assert_eq!(line.fit(12, Some(Style::Plain)).width(), 12);
        let text = to_terminal(&[fit], false);
        assert_eq!(text, "\x1b[Hab?cde\x1b[K\x1b[J");
    }

    #[test]
    fn without_colours_there_are_none() {
        let line = Line::of(Style::Bad, "x");
        assert!(to_terminal(std::slice::from_ref(&line), true).contains("\x1b[31m"));
        assert!(!to_terminal(&[line], false).contains("\x1b[3"));
    }
}
