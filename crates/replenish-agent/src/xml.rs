//! The little XML that XRCE clients send: `<dds><data_writer><topic><name>…`.
//!
//! This is no XML parser: it finds elements by name and reads their text. That is enough for the
//! strings that stock clients build, bounded by the message they came in, and cannot recurse.

/// The contents of the first element `tag` in `xml`, or `None` when it is missing or not closed.
///
/// Attributes are skipped; an element of the same name nested inside ends the outer one early.
pub(crate) fn element<'a>(xml: &'a str, tag: &str) -> Option<&'a str> {
    let (_attributes, contents) = open(xml, tag)?;
    until_close(contents, tag)
}

/// The value of attribute `name` of the first element `tag`.
pub(crate) fn attribute<'a>(xml: &'a str, tag: &str, name: &str) -> Option<&'a str> {
    let (attributes, _contents) = open(xml, tag)?;
    let mut rest = attributes;
    loop {
        let (before, after) = rest.split_once('=')?;
        let after = after.trim_start();
        let quote = after.chars().next().filter(|c| matches!(c, '"' | '\''))?;
        let (value, next) = after.get(1..)?.split_once(quote)?;
        if before.trim() == name {
            return Some(value);
        }
        rest = next;
    }
}

/// The attributes of the first element `tag`, and the text after its opening.
fn open<'a>(xml: &'a str, tag: &str) -> Option<(&'a str, &'a str)> {
    let mut rest = xml;
    loop {
        let (_, after) = rest.split_once('<')?;
        rest = after;
        let Some(tail) = after.strip_prefix(tag) else {
            continue;
        };
        if !tail.starts_with(['>', '/', ' ', '\t', '\r', '\n']) {
            continue; // a longer name
        }
        return tail.split_once('>');
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
    fn attributes_are_found_by_name_even_without_space_between_them() {
        let xml =
            "<dds><replier profile_name=\"p\"service_name = 's'\n type=\"a=b\"></replier></dds>";
        let of = |name| attribute(xml, "replier", name);
        assert_eq!(of("profile_name"), Some("p"));
        assert_eq!(of("service_name"), Some("s"));
        assert_eq!(of("type"), Some("a=b"));
        assert_eq!(of("name"), None);
        assert_eq!(attribute("<a b=c d=\"e\">", "a", "d"), None);
        assert_eq!(attribute("<a b=\"c\"/>", "a", "b"), Some("c"));
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
