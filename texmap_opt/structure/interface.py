"""How two kinds of unit cells are joined where they meet: the numbers of the report."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Interface:
    """All faces in which a cell of one kind meets a cell of another.

    Attributes:
        kinds: names of the two unit cells.
        faces: how many faces of the grid.
        shared_joints: joints in them that both kinds have.
        split_struts: struts in them that end in a joint where they cross or touch one of the other
            kind, instead of running on.
        transition_struts: struts added between joints of one kind and joints of the other.
    """

    kinds: tuple[str, str]
    faces: int
    shared_joints: int
    split_struts: int
    transition_struts: int

    @property
    def method(self) -> str:
        """What it took at the most: "shared" (joints), "crossed" (struts split), "transition"."""
        if self.transition_struts:
            return "transition"
        return "crossed" if self.split_struts else "shared"

    def numbers(self) -> dict[str, str | int | list[str]]:
        """The entry of report.json."""
        return {
            "kinds": list(self.kinds),
            "method": self.method,
            "faces": self.faces,
            "shared_joints": self.shared_joints,
            "split_struts": self.split_struts,
            "transition_struts": self.transition_struts,
        }
