"""One period of a periodic frame, in space or in the plane: every joint and every strut once."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from fea.beam import StrutMaterial
from fea.errors import FeaError, position_text
from fea.periodicity import cell_volume, check_connected, images
from fea.sections import Wall

# Radii of images of one strut agree to this share.
SAME_RADIUS = 1e-9


@dataclass(frozen=True, eq=False)
class PeriodicFrame:
    """Joints and struts of one period.

    In space there are three periods. In the plane, d = 2, there are two and the struts are walls of an
    extruded lattice: `material.section` is a `fea.Wall`, whose depth is that of the period.

    Attributes:
        joints: positions [mm].
        struts: the two joints of each strut.
        offsets: periods from the second joint to the image of it that the strut ends at.
        periods: the d period vectors, one a row [mm].
        radii: section radius at both ends of each strut [mm].
        material: E [MPa], nu and section.
        rigid_ends: length at each end that does not deform [mm]; None: none.
        modulus: factor on E and G of each strut; None: one.
    """

    joints: Float[np.ndarray, "joints d"]
    struts: Int[np.ndarray, "struts 2"]
    offsets: Int[np.ndarray, "struts d"]
    periods: Float[np.ndarray, "d d"]
    radii: Float[np.ndarray, "struts 2"]
    material: StrutMaterial
    rigid_ends: Float[np.ndarray, "struts 2"] | None = None
    modulus: Float[np.ndarray, " struts"] | None = None

    @classmethod
    def from_block(
        cls,
        joints: Float[np.ndarray, "points d"],
        struts: Int[np.ndarray, "elements 2"],
        radii: Float[np.ndarray, "elements 2"],
        periods: Float[np.ndarray, "d d"],
        material: StrutMaterial,
    ) -> "PeriodicFrame":
        """A frame from a block that shows one period, with what its faces share on both sides.

        Args:
            joints: positions [mm]; images on opposite faces become one joint.
            struts: the two joints of each strut; images become one strut.
            radii: section radius at both ends of each strut [mm].
            periods: the d period vectors, one a row [mm].
            material: E [MPa], nu and section.

        Raises:
            FeaError: when joints nearly match, coincide, a strut is given twice, or images of one
                strut differ in radius.
        """
        image = images(joints, periods)
        same = np.unique(np.sort(struts, axis=1), axis=0, return_index=True)[1]
        if len(same) < len(struts):
            again = int(np.setdiff1d(np.arange(len(struts)), same)[0])
            raise FeaError(f"Strut {again} joins the same joints as an earlier one; remove it.")
        a, b = image.number[struts].T
        step = image.offset[struts[:, 1]] - image.offset[struts[:, 0]]
        # From either end the same strut: the smaller number first; in a loop a step forwards.
        backward = (a > b) | ((a == b) & _is_backward(step))
        key = np.column_stack([np.minimum(a, b), np.maximum(a, b), step])
        key[backward, 2:] *= -1
        towards = np.where(backward[:, None], radii[:, ::-1], radii)
        _, kept, of = np.unique(key, axis=0, return_index=True, return_inverse=True)
        differs = np.abs(towards - towards[kept][of.reshape(-1)]).max(axis=1, initial=0.0)
        if (differs > SAME_RADIUS * np.abs(radii).max(initial=0.0)).any():
            strut = int(np.argmax(differs))
            other = int(kept[of.reshape(-1)[strut]])
            raise FeaError(
                f"Struts {strut} and {other} are images of each other, but their radii differ by "
                f"{differs[strut]:.3g} mm; give both the same."
            )
        kept = np.sort(kept)
        return cls(
            joints=joints[image.first],
            struts=np.column_stack([a, b])[kept],
            offsets=step[kept],
            periods=periods,
            radii=radii[kept],
            material=material,
        )

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """What the stiffness can be differentiated by, as far as it is given."""
        given = {name: getattr(self, name) for name in ("joints", "radii", "rigid_ends", "modulus")}
        return {name: value for name, value in given.items() if value is not None}

    @property
    def volume(self) -> float:
        """Volume of one period [mm³], solid and void."""
        section = self.material.section
        return cell_volume(self.periods) * (section.depth if isinstance(section, Wall) else 1.0)

    @property
    def dimensions(self) -> int:
        """3 in space, 2 in the plane."""
        return len(self.periods)

    @property
    def ends(self) -> Float[np.ndarray, "struts 2 d"]:
        """Where each strut begins and ends [mm]."""
        ends = self.joints[self.struts]
        ends[:, 1] += self.offsets @ self.periods
        return ends

    @property
    def strut_volume(self) -> float:
        """Volume of the struts between their joints [mm³]; what joints share is counted by each."""
        return float(_strut_volumes(self).sum())

    @property
    def density(self) -> float:
        """`strut_volume` over `volume`: the centre-line density, above the true one."""
        return self.strut_volume / self.volume

    def check(self) -> None:
        """Refuse what has no effective stiffness.

        Raises:
            FeaError: for numbers that are none, struts without length or thickness, that do not
                exist or are given twice, constants that no material has, a frame that falls apart.
        """
        cell_volume(self.periods)
        self._check_section()
        count = len(self.joints)
        for name in ("offsets", "radii", "rigid_ends", "modulus"):
            values = getattr(self, name)
            if values is not None and len(values) != len(self.struts):
                raise FeaError(
                    f"{name} of the periodic frame has {len(values)} rows; its {len(self.struts)} struts "
                    "need one each."
                )
        if not len(self.struts):
            raise FeaError("The periodic frame has no struts; give at least one.")
        if not 0 <= self.struts.min() <= self.struts.max() < count:
            raise FeaError(
                f"Struts refer to joints {self.struts.min()} to {self.struts.max()}, but the "
                f"periodic frame has joints 0 to {count - 1}."
            )
        for name, values in self.parameters.items():
            lost = np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))
            if len(lost):
                raise FeaError(f"{name}[{lost[0]}] of the periodic frame is not a number.")
        E, nu = self.material.E, self.material.nu
        if not (0 < E < np.inf and -1 < nu <= 0.5):
            raise FeaError(f"E = {E:g}, nu = {nu:g}: need E > 0 and -1 < nu <= 0.5.")
        self._check_struts()
        check_connected(self.struts, self.joints, "frame")

    def _check_section(self) -> None:
        section = self.material.section
        if self.dimensions == 2 and not isinstance(section, Wall):
            raise FeaError(
                f"A periodic frame in the plane has struts of section {type(section).__name__}, which says "
                "nothing of their depth; give Wall."
            )
        if self.dimensions == 3 and isinstance(section, Wall):
            raise FeaError(
                "A periodic frame in space has struts of section Wall, which bends in its plane only; "
                "give joints and periods two coordinates, or another section."
            )

    def _check_struts(self) -> None:
        ends = self.ends
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        rigid = np.zeros((len(length), 2)) if self.rigid_ends is None else self.rigid_ends
        modulus = np.ones(len(length)) if self.modulus is None else self.modulus
        for wrong, what in (
            (~(length > 0), "has no length; merge its joints"),
            (
                ~(self.radii > 0).all(axis=1),
                "has a radius that is not positive; give both ends one",
            ),
            ((rigid < 0).any(axis=1), "has a rigid end of negative length; give zero or more"),
            (~(rigid.sum(axis=1) < length), "is rigid from end to end; shorten its rigid ends"),
            (~(modulus > 0), "has a relative modulus that is not positive; give a positive one"),
            (self._repeats(), "repeats an earlier strut; remove one of them"),
        ):
            if wrong.any():
                strut = int(np.argmax(wrong))
                place = position_text(ends[strut].mean(axis=0))
                raise FeaError(f"Strut {strut} of the periodic frame, at {place} mm, {what}.")

    def _repeats(self) -> Bool[np.ndarray, " struts"]:
        a, b = self.struts.T
        backward = (a > b) | ((a == b) & _is_backward(self.offsets))
        key = np.column_stack([np.sort(self.struts, axis=1), self.offsets])
        key[backward, 2:] *= -1
        again = np.ones(len(key), bool)
        again[np.unique(key, axis=0, return_index=True)[1]] = False
        return again


def _is_backward(step: Int[np.ndarray, "struts d"]) -> Bool[np.ndarray, " struts"]:
    """True where the first component that is not zero is negative."""
    first = np.argmax(step != 0, axis=1)
    return np.take_along_axis(step, first[:, None], axis=1)[:, 0] < 0


def _strut_volumes(frame: PeriodicFrame) -> Float[np.ndarray, " struts"]:
    """Length times Simpson's mean of the area, exact for linear taper."""
    ends, section = frame.ends, frame.material.section
    first, second = frame.radii.T
    area = section.area(first) + 4 * section.area((first + second) / 2) + section.area(second)
    return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) * area / 6)
