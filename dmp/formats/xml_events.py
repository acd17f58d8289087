"""Reading XML from a stranger: elements one by one, bounded in number and depth, and nothing but elements.

Declarations of document types and entities, the door of every known attack with XML, are refused at sight; no other
file is ever opened.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from xml.parsers import expat

from dmp.formats.source import FormatError
from dmp.formats.text import encoding_of, show, transcode

_MAXIMUM_DEPTH = 64
# No mesh file has elements of more than a few dozen attributes; millions of them fill the memory before anything is told.
_MAXIMUM_ATTRIBUTES = 1000
_ATTRIBUTE_BYTES = 4  # of the shortest, such as a=""
# Never fails after a letter and never goes back, so that no text makes it look at anything twice.
_BEGINNING_OF_TAG = re.compile(rb"""<[^\W\d](?:[^<>"']*+(?:"[^"]*+"|'[^']*+'))*+""")
_USUAL_ATTRIBUTES, _MAXIMUM_SURPLUS = 12, 20_000
_RESAVE = "Save or copy the file again from where it came from."


class XmlEvents:
    """Walks through a document and calls functions for its elements.

    Args:
        where: what to call the document in messages, such as "the part '3D/3dmodel.model'"; empty for the file itself.
        maximum_elements: how many elements it may have.
        namespaces: whether names are given as "NAMESPACE NAME" with the full address of their namespace.
    """

    def __init__(self, where: str, maximum_elements: int, *, namespaces: bool = False) -> None:
        self.where = where
        self._maximum_elements = maximum_elements
        self._namespaces = namespaces
        self._n_elements = self._depth = 0
        self._parser: expat.XMLParserType | None = None

    @property
    def byte(self) -> int:
        """Where the element begins that is just being told, in the UTF-8 text."""
        assert self._parser is not None
        return self._parser.CurrentByteIndex

    def error(self, cause: str, remedy: str = _RESAVE) -> FormatError:
        """Return an error with the line of the element that is just being told."""
        assert self._parser is not None
        return FormatError(f"{self._place(self._parser.CurrentLineNumber)}: {cause}", remedy)

    def _place(self, line: int) -> str:
        return f"{self.where}, line {line:,}" if self.where else f"line {line:,}"

    def parse(
        self,
        content: bytes,
        start: Callable[[str, dict[str, str]], None],
        end: Callable[[str], None],
        namespace: Callable[[str, str], None] | None = None,
        *,
        encoding: str | None = None,
    ) -> None:
        """Read a whole document.

        Args:
            content: the document.
            start: called with the name and the attributes of each element.
            end: called with its name when it is closed.
            namespace: called with each prefix that is declared, and what it stands for.
            encoding: that of the content, where it is not the one that the document declares.

        Raises:
            FormatError: with the line, when it is no well-formed XML, declares a document type or entities, or has too
                many elements; and whatever the functions raise.
        """
        if encoding_of(content[:4]) != "utf-8":
            content, encoding = transcode(content), "utf-8"
        parser = expat.ParserCreate(encoding, " " if self._namespaces else None)
        self._parser = parser
        limit, self._n_elements, self._depth = self._maximum_elements, 0, 0
        n_surplus = 0
        # Before the parser sees it, because it tells of an element only when it has taken in all of its attributes.
        for tag in _BEGINNING_OF_TAG.finditer(content):
            n_bytes = tag.end() - tag.start()
            if n_bytes > _ATTRIBUTE_BYTES * _MAXIMUM_ATTRIBUTES and tag[0].count(b"=") > _MAXIMUM_ATTRIBUTES:
                line = content.count(b"\n", 0, tag.start()) + 1
                raise FormatError(f"{self._place(line)}: an element has more than {_MAXIMUM_ATTRIBUTES:,} attributes", _RESAVE)

        def on_start(name: str, attributes: dict[str, str]) -> None:
            nonlocal n_surplus
            if len(attributes) > _USUAL_ATTRIBUTES:
                n_surplus += len(attributes)
                if n_surplus > _MAXIMUM_SURPLUS:
                    raise self.error("elements have far more attributes than any mesh file needs", _RESAVE)
            self._n_elements += 1
            self._depth += 1
            if self._n_elements > limit or self._depth > _MAXIMUM_DEPTH:
                raise self.error(
                    f"there are more than {limit:,} elements" if self._n_elements > limit else "elements are nested too deeply",
                    "Save only the part of the file that you need.",
                )
            start(name, attributes)

        def on_end(name: str) -> None:
            self._depth -= 1
            end(name)

        def refuse(*_: object) -> None:
            raise self.error("a document type or an entity is declared, which a mesh file never needs")

        def declare(prefix: str | None, address: str | None) -> None:
            if namespace is not None:
                namespace(prefix or "", address or "")

        parser.StartElementHandler = on_start
        parser.EndElementHandler = on_end
        parser.StartDoctypeDeclHandler = refuse
        parser.EntityDeclHandler = refuse
        parser.StartNamespaceDeclHandler = declare
        try:
            # In one piece: some releases of the parser take quadratic time for long texts that come in parts.
            parser.Parse(content, True)
        except expat.ExpatError as error:
            reason = show(expat.ErrorString(error.code).encode())
            raise FormatError(f"{self._place(error.lineno)}: the XML text is damaged ({reason})", _RESAVE) from error
        except (LookupError, UnicodeError, ValueError) as error:
            raise FormatError(f"{self._place(1)}: the XML text is in an unknown encoding", "Save the file as UTF-8.") from error
