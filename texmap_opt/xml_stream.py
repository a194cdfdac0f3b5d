"""XML read as a stream of events: memory holds what the listener keeps, never a tree."""

import math
from collections.abc import Callable, Iterable, Mapping
from io import BufferedIOBase
from typing import NoReturn
from xml.parsers import expat

from texmap_opt.errors import StructureError

# Between the address of a namespace and a tag's own name; neither holds a blank.
NAMESPACE_SEPARATOR = " "
# Digits of a whole number that 64 bits hold for certain; Python itself gives up at 4,300.
MAX_DIGITS = 18


class XmlStream:
    """The events of one file, and refusals that name the file and the line.

    A document type is refused where it begins, before any entity of it can be defined, and so
    nothing in a file can grow on reading.

    Attributes:
        file: what messages call it.
        parser: tells the line.
    """

    def __init__(self, file: str, *, namespaces: bool = False) -> None:
        self.file = file
        self.parser = expat.ParserCreate(
            namespace_separator=NAMESPACE_SEPARATOR if namespaces else None
        )
        self.parser.buffer_text = True
        self.parser.StartDoctypeDeclHandler = self._refuse_doctype

    def read(
        self,
        source: BufferedIOBase,
        *,
        start: Callable[[str, dict[str, str]], None],
        end: Callable[[str], None],
        text: Callable[[str], None],
    ) -> None:
        """Tell every element as it begins and ends, and the text between.

        Raises:
            StructureError: for what is no XML.
        """
        self.parser.StartElementHandler = start
        self.parser.EndElementHandler = end
        self.parser.CharacterDataHandler = text
        try:
            self.parser.ParseFile(source)
        except expat.ExpatError as failure:
            raise StructureError(
                f"{self.file}, line {failure.lineno}: is not XML "
                f"({expat.ErrorString(failure.code)}); write the file again."
            ) from failure
        except (LookupError, ValueError) as failure:
            # Of a declared encoding that there is not, or that is not one of text.
            raise StructureError(
                f"{self.file}, line {self.parser.CurrentLineNumber}: cannot be decoded ({failure}); "
                "write the file again in UTF-8."
            ) from failure

    def refuse(self, message: str) -> NoReturn:
        """Stop at the line that has been read."""
        raise StructureError(f"{self.file}, line {self.parser.CurrentLineNumber}: {message}")

    def demand(self, tag: str, attributes: Mapping[str, str], keys: Iterable[str]) -> None:
        """Refuse an element without one of these attributes."""
        for key in keys:
            if key not in attributes:
                self.refuse(
                    f'<{tag}> lacks its attribute "{key}"; add it, or write the file again.'
                )

    def numbers(self, words: list[str], what: str, count: int) -> list[float]:
        """So many finite numbers."""
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        # Python's own reading is wider: it takes 1_000 and the digits of every script.
        plain = all(word.isascii() and "_" not in word for word in words)
        if len(values) != count or not plain or not all(map(math.isfinite, values)):
            self.refuse(f'{what} has "{" ".join(words)[:60]}"; it needs {count} finite numbers.')
        return values

    def positive(self, word: str, what: str) -> float:
        """One positive number."""
        value = self.numbers([word], what, 1)[0]
        if value <= 0:
            self.refuse(f"{what} is {word}; it must be positive.")
        return value

    def whole(self, text: str, key: str) -> int:
        """A whole number, 0 or more."""
        if not (text.isascii() and text.isdigit() and len(text) <= MAX_DIGITS):
            self.refuse(f'{key} is "{text[:60]}"; it must be a whole number, 0 or more.')
        return int(text)

    def _refuse_doctype(self, *_: object) -> None:
        self.refuse("has a document type; such a file has none, remove it.")
