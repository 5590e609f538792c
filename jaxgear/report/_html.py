"""HTML as text: elements whose content is escaped unless it is HTML itself."""

import html
from collections.abc import Iterable, Sequence

# Elements without content.
_EMPTY = ("img", "meta")


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def element(name: str, /, *content: str, **attributes: str) -> Markup:
    """Write one element.

    **Arguments:**

    - `name`: of the element.
    - `content`: what it holds; plain text is escaped.
    - `attributes`: its own; in a name an underscore is a hyphen, and left out at the end, so that
        `aria_label` and `class_` can be written.
    """
    given = [f' {_spelt(key)}="{html.escape(value)}"' for key, value in attributes.items()]
    start = f"<{name}{''.join(given)}>"
    return Markup(start if name in _EMPTY else f"{start}{joined(content)}</{name}>")


def _spelt(key: str) -> str:
    return key.rstrip("_").replace("_", "-")


def joined(content: Iterable[str]) -> Markup:
    """Write one after the other; plain text is escaped."""
    return Markup(
        "".join(each if isinstance(each, Markup) else html.escape(each) for each in content)
    )


def table(head: Sequence[str], rows: Iterable[Sequence[str]], caption: str = "") -> Markup:
    """Write a table; the first cell of a row names it.

    **Arguments:**

    - `head`: the names of the columns.
    - `rows`: the cells of each row.
    - `caption`: what it is about; none without.
    """
    top = element("tr", *(element("th", name, scope="col") for name in head))
    body = [
        element(
            "tr",
            element("th", first, scope="row"),
            *(element("td", cell) for cell in rest),
        )
        for first, *rest in rows
    ]
    above = [element("caption", caption)] if caption else []
    whole = element("table", *above, element("thead", top), element("tbody", *body))
    # On a narrow screen a wide table moves by itself.
    return element("div", whole, class_="wide")
