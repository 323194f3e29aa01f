"""Sections of a page that programs write, between ``<!-- NAME -->`` and ``<!-- /NAME -->``."""


def section_of(text: str, name: str) -> str:
    """Return the text between the marks.

    Raises
    ------
    ValueError
        The marks are missing.
    """
    return _parts(text, name)[1].strip()


def with_section(text: str, name: str, section: str) -> str:
    """Return a text with another section between the marks.

    Raises
    ------
    ValueError
        The marks are missing.
    """
    head, _, tail = _parts(text, name)
    return f"{head}<!-- {name} -->\n{section}\n<!-- /{name} -->{tail}"


def _parts(text: str, name: str) -> tuple[str, str, str]:
    """Return the text before, between and after the marks."""
    begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    head, found, rest = text.partition(begin)
    section, closed, tail = rest.partition(end)
    if not (found and closed):
        raise ValueError(f"no {begin} ... {end} in the text")
    return head, section, tail
