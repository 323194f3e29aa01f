"""Sections of a page that programs write: what stands between ``<!-- NAME -->`` and ``<!-- /NAME -->``."""


def section_of(text: str, name: str) -> str:
    """Give what stands between the marks.

    Raises
    ------
    ValueError
        The marks are missing.
    """
    return _parts(text, name)[1].strip()


def with_section(text: str, name: str, section: str) -> str:
    """Give a text with another section between the marks.

    Raises
    ------
    ValueError
        The marks are missing.
    """
    head, _, tail = _parts(text, name)
    return f"{head}<!-- {name} -->\n{section}\n<!-- /{name} -->{tail}"


def _parts(text: str, name: str) -> tuple[str, str, str]:
    """What stands before, between and behind the marks."""
    begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    head, found, rest = text.partition(begin)
    section, closed, tail = rest.partition(end)
    if not (found and closed):
        raise ValueError(f"no {begin} ... {end} in the text")
    return head, section, tail
