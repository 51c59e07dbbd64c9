//! The little XML that XRCE clients send: `<dds><data_writer><topic><name>…`.
//!
//! Not an XML parser: it finds elements by name and reads their text. That is enough for the
//! strings that stock clients build, bounded by the message they came in, and cannot recurse.

/// The contents of the first element `tag` in `xml`, or `None` when it is missing or not closed.
///
/// Attributes are skipped; an element of the same name nested inside ends the outer one early.
pub(crate) fn element<'a>(xml: &'a str, tag: &str) -> Option<&'a str> {
    let mut rest = xml;
    loop {
        let (_, after) = rest.split_once('<')?;
        rest = after;
        let Some(tail) = after.strip_prefix(tag) else {
            continue;
        };
        if !tail.starts_with(['>', ' ', '\t', '\r', '\n']) {
            continue; // a longer name
        }
        let (_attributes, contents) = tail.split_once('>')?;
        return until_close(contents, tag);
    }
}

/// The text of an element found by a path of names, without surrounding white space.
pub(crate) fn text<'a>(xml: &'a str, path: &[&str]) -> Option<&'a str> {
    path.iter()
        .try_fold(xml, |xml, tag| element(xml, tag))
        .map(str::trim)
}

fn until_close<'a>(contents: &'a str, tag: &str) -> Option<&'a str> {
    let mut at = 0;
    loop {
        let open = at + contents.get(at..)?.find("</")?;
        let name = contents.get(open + 2..)?;
        if name
            .strip_prefix(tag)
            .is_some_and(|t| t.trim_start().starts_with('>'))
        {
            return contents.get(..open);
        }
        at = open + 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const READER: &str = "<dds><data_reader><topic><kind>NO_KEY</kind><name>HelloWorldTopic</name>\
        <dataType>HelloWorld</dataType></topic></data_reader></dds>";

    #[test]
    fn finds_the_elements_of_a_stock_string() {
        assert_eq!(text(READER, &["topic", "name"]), Some("HelloWorldTopic"));
        assert_eq!(text(READER, &["topic", "dataType"]), Some("HelloWorld"));
        assert_eq!(text(READER, &["qos"]), None);
    }

    #[test]
    fn a_longer_name_is_another_element() {
        assert_eq!(
            element("<topics>a</topics><topic>b</topic>", "topic"),
            Some("b")
        );
        assert_eq!(element("<a>x</ab></a>", "a"), Some("x</ab>"));
    }

    #[test]
    fn attributes_and_white_space_are_skipped() {
        assert_eq!(text("<a k=\"v\">\n x </a >", &["a"]), Some("x"));
    }

    #[test]
    fn what_is_not_closed_is_not_there() {
        for xml in [
            "<a",
            "<a>",
            "<a>b",
            "<a>b</",
            "<a>b</b>",
            "",
            "<",
            "</a>",
            "<\u{e9}a>",
        ] {
            assert_eq!(element(xml, "a"), None, "{xml}");
        }
    }
}
