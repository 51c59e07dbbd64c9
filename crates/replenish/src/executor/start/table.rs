//! Tables for people: each column is as wide as its longest cell, so that they line up whatever
//! names and ids there are. Nothing is cut off.

use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;

/// Rows of `N` cells: the first `names` of them are left-aligned, the others right-aligned.
pub(super) struct Table<const N: usize> {
    names: usize,
    rows: Vec<([String; N], &'static str)>,
}

impl<const N: usize> Table<N> {
    pub(super) fn new(names: usize, heads: [&str; N]) -> Self {
        let heads = heads.map(String::from);
        Self {
            names,
            rows: alloc::vec![(heads, "")],
        }
    }

    /// Adds one more row; `remark` stands behind it.
    pub(super) fn add(&mut self, cells: [String; N], remark: &'static str) {
        self.rows.push((cells, remark));
    }
}

impl<const N: usize> fmt::Display for Table<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut widths = [0; N];
        for (cells, _) in &self.rows {
            for (width, cell) in widths.iter_mut().zip(cells) {
                *width = cell.chars().count().max(*width);
            }
        }
        for (cells, remark) in &self.rows {
            for (at, (cell, width)) in cells.iter().zip(widths).enumerate() {
                let gap = if at == 0 { "" } else { "  " };
                if at < self.names {
                    write!(f, "{gap}{cell:<width$}")?;
                } else {
                    write!(f, "{gap}{cell:>width$}")?;
                }
            }
            let gap = if remark.is_empty() { "" } else { "  " };
            writeln!(f, "{gap}{remark}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up_whatever_is_in_them() {
        let mut table = Table::new(1, ["handle", "received"]);
        table.add(["/ä:/scan".into(), "7".into()], "");
        table.add(["/a/long/name".into(), "12345678901".into()], "panicked");
        let expected = "handle           received\n\
                        /ä:/scan                7\n\
                        /a/long/name  12345678901  panicked\n";
        assert_eq!(alloc::format!("{table}"), expected);
    }
}
