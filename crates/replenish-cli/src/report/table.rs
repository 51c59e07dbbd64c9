//! Plain-text tables with aligned columns.

/// A table under construction.
#[derive(Debug)]
pub struct Table {
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table whose first row names the columns.
    pub fn new(columns: &[&str]) -> Self {
        Self {
            rows: vec![columns.iter().map(ToString::to_string).collect()],
        }
    }

    /// Adds a row.
    pub fn row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// The rows; the first one names the columns.
    pub fn rows(&self) -> &[Vec<String>] {
        &self.rows
    }

    /// The table as text. Columns whose cells are all numbers are aligned to the right.
    pub fn to_text(&self) -> String {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let cells = |c: usize| self.rows.iter().filter_map(move |r| r.get(c));
        let width: Vec<usize> = (0..columns)
            .map(|c| cells(c).map(|s| s.chars().count()).max().unwrap_or(0))
            .collect();
        let right: Vec<bool> = (0..columns)
            .map(|c| cells(c).skip(1).all(|s| is_number(s)))
            .collect();
        let mut text = String::new();
        for (n, row) in self.rows.iter().enumerate() {
            let mut line = String::new();
            for (c, cell) in row.iter().enumerate() {
                let w = width.get(c).copied().unwrap_or(0);
                if right.get(c).copied().unwrap_or(false) {
                    line.push_str(&format!("  {cell:>w$}"));
                } else {
                    line.push_str(&format!("  {cell:<w$}"));
                }
            }
            text.push_str(line.trim_end());
            text.push('\n');
            if n == 0 {
                let rule: Vec<String> = width.iter().map(|w| "-".repeat(*w)).collect();
                text.push_str(&format!("  {}\n", rule.join("  ")));
            }
        }
        text
    }
}

/// Whether a cell is a number, with or without a unit sign, or a dash for "none".
pub fn is_number(cell: &str) -> bool {
    let first = cell.trim_start_matches(['+', '-', '−']).chars().next();
    cell == "-" || first.is_some_and(|c| c.is_ascii_digit())
}

/// A count, or a dash where there is none.
pub fn count(n: Option<u64>) -> String {
    n.map_or_else(|| "-".to_string(), |n| n.to_string())
}

/// A percentage for people: `30.00 %`.
pub fn percent(x: f64) -> String {
    percent_with(x, 2)
}

/// A percentage with `decimals` decimals; never `-0.0 %`.
pub fn percent_with(x: f64, decimals: usize) -> String {
    format!("{:.decimals$} %", without_minus_zero(x, decimals))
}

/// A signed percentage for people: `+0.030 %`, and `0.000 %` without a sign.
pub fn signed_percent(x: f64) -> String {
    match without_minus_zero(x, 3) {
        0.0 => "0.000 %".into(),
        x => format!("{x:+.3} %"),
    }
}

/// The number as it will be printed: with `decimals` decimals, and without the sign of a zero.
fn without_minus_zero(x: f64, decimals: usize) -> f64 {
    let scale = 10f64.powi(i32::try_from(decimals).unwrap_or(0));
    if (x * scale).abs() < 0.5 { 0.0 } else { x }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zero_has_no_sign() {
        for x in [0.0, -0.0, 0.0004, -0.0004, -0.0] {
            assert_eq!(signed_percent(x), "0.000 %", "{x}");
            assert_eq!(percent(x), "0.00 %", "{x}");
        }
        assert_eq!(percent_with(-0.04, 1), "0.0 %");
        assert_eq!(signed_percent(-0.0006), "-0.001 %");
        assert_eq!(signed_percent(0.0306), "+0.031 %");
        assert_eq!(percent_with(-0.06, 1), "-0.1 %");
    }

    #[test]
    fn numbers_go_right_and_words_left() {
        let mut t = Table::new(&["topic", "sent"]);
        t.row(["high", "800"]);
        t.row(["a longer one", "7"]);
        assert_eq!(
            t.to_text(),
            "  topic         sent\n  ------------  ----\n  high           800\n  a longer one     7\n"
        );
    }
}
