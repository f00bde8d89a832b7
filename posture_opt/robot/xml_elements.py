"""XML as plain elements with their lines, read by expat; a document type, and with it every entity, is refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers import expat

from posture_opt.errors import InputError, Issue

MAX_ELEMENTS = 100_000  # a humanoid with hands has some ten thousand


@dataclass(frozen=True)
class Element:
    """One element: its attributes, the elements inside it, and the line that it begins in; texts are left out."""

    tag: str
    attributes: dict[str, str]
    line: int
    inside: list[Element] = field(default_factory=list)

    def first(self, tag: str) -> Element | None:
        """The first element ``tag`` right inside this one."""
        return next((element for element in self.inside if element.tag == tag), None)

    def each(self, tag: str) -> Iterator[Element]:
        """The elements ``tag`` right inside this one."""
        return (element for element in self.inside if element.tag == tag)


def read_elements(data: bytes) -> tuple[Element, ...]:
    """All elements of an XML document in the order of the file, the outermost first.

    Raises:
        InputError: no well-formed XML, more than ``MAX_ELEMENTS`` elements, or a DOCTYPE: what an entity of it stands
            for is seen by some readers and not by others, and 0.5 could become 5.
    """
    reader = _ElementReader()
    try:
        reader.parser.Parse(data, True)
    except expat.ExpatError as error:
        raise InputError(Issue(f"the file is not XML: {expat.ErrorString(error.code)}", line=error.lineno)) from None
    except (LookupError, ValueError) as error:  # of an encoding that nobody knows
        raise InputError(Issue(f"the file is not XML: {error}", mend="save the file as UTF-8", line=1)) from None
    return tuple(reader.elements)


class _ElementReader:
    """Collects what expat tells."""

    def __init__(self) -> None:
        self.elements: list[Element] = []
        self.around: list[Element] = []
        self.parser = expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if len(self.elements) == MAX_ELEMENTS:
            raise InputError(Issue(f"the file has more than {MAX_ELEMENTS} elements, which no robot description has"))
        element = Element(tag, attributes, self.parser.CurrentLineNumber)
        if self.around:
            self.around[-1].inside.append(element)
        self.around.append(element)
        self.elements.append(element)

    def _end(self, tag: str) -> None:
        self.around.pop()

    def _doctype(self, name: str, *declared: object) -> NoReturn:
        mend = "remove <!DOCTYPE …>, and write numbers and names in place of its &entities;"
        message = "a robot description has no DOCTYPE and no entities"
        raise InputError(Issue(message, mend=mend, line=self.parser.CurrentLineNumber))
