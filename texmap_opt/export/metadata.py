"""What a file says about itself beside its geometry."""

import importlib.metadata
from dataclasses import dataclass
from datetime import datetime


@dataclass(frozen=True)
class Metadata:
    """Title and origin of a file.

    Attributes:
        title: a few words.
        description: a sentence or more; empty: none.
        creation_date: None: left out, so that equal content gives equal files.
    """

    title: str
    description: str = ""
    creation_date: datetime | None = None

    def entries(self) -> dict[str, str]:
        """Texts of one line each, under the names of the 3MF Core Specification 1.4.0, section 3.4.1.1."""
        date = "" if self.creation_date is None else self.creation_date.isoformat()
        entries = {
            "Title": self.title,
            "Description": self.description,
            "Application": f"texmap-opt {importlib.metadata.version('texmap-opt')}",
            "CreationDate": date,
        }
        return {name: _one_line(text) for name, text in entries.items() if text}


def _one_line(text: str) -> str:
    """Without what ends a comment or is no character of XML: line breaks, controls, lone surrogates."""
    return "".join(c if c.isprintable() else " " for c in text)
