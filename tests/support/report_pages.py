"""Reading of the reports' pages."""

from html.parser import HTMLParser

VOID = {"meta", "link", "img", "br", "hr"}
"""Elements without an end."""


class Reader(HTMLParser):
    """Reads a page: its sections' text by anchor, and whether every element is closed."""

    def __init__(self, text):
        super().__init__()
        self.sections, self.images, self.references, self._open = {}, [], [], []
        self._section = None
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag not in VOID:
            self._open.append(tag)
        if tag == "section":
            self._section = values["id"]
            self.sections[self._section] = ""
        if tag == "img":
            self.images.append(values)
        self.references += [values[name] for name in ("src", "href") if name in values]

    def handle_endtag(self, tag):
        assert self._open.pop() == tag
        if tag == "section":
            self._section = None

    def handle_data(self, data):
        if self._section is not None:
            self.sections[self._section] += data


def read(path):
    return Reader(path.read_text("utf-8"))
