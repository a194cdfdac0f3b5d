"""Every error a user can cause or meet, and how the program answers: one sentence, one exit code."""

import difflib
from collections.abc import Iterable


class TexmapError(Exception):
    """Root of all errors that reach a user as one sentence.

    The message names what was wrong (file, key, value), the limit, and the remedy.
    """

    exit_code = 1


class InputError(TexmapError):
    """What the user gave cannot be used; the command ends with code 2."""

    exit_code = 2


class CaseError(InputError):
    """A case file has a missing, unknown or impossible entry."""


class PartError(InputError):
    """A part file cannot be read or is not a solid."""


class CellError(InputError):
    """A unit-cell file is unknown or malformed."""


class StructureError(InputError):
    """A structure file is malformed, or a structure breaks its invariants."""


class TetrahedralisationError(TexmapError):
    """The tet mesher failed or returned a mesh that is not the part."""


class AnalysisError(TexmapError):
    """The stress analysis could not be solved."""


class WarpError(TexmapError):
    """A warp folds, does not converge, or cannot be computed."""


class LatticeError(TexmapError):
    """No usable lattice comes out: it misses the part, falls apart, or reaches no support."""


class SizingError(TexmapError):
    """The strut radii cannot meet what is asked of them."""


class SolidError(TexmapError):
    """A surface mesh is not the boundary of a solid, or a boolean failed."""


class OutputError(TexmapError):
    """A file cannot be written."""


def nearest_name(name: str, known: Iterable[str]) -> str:
    """Remedy for a misspelt name: `did you mean "x"?`, or the list of what is known."""
    known = sorted(known)
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    if close:
        return f'did you mean "{close[0]}"?'
    return "known: " + ", ".join(known) + "."
