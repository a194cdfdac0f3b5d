"""Struts that buckle as one: a column goes on through a joint that nothing holds sideways."""

import math

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fea.frame import FrameProblem

# Largest angle by which a column turns from one strut to the next. Turned by an angle a, the joint is held
# sideways by 2 (E A/l) sin²(a/2), l the length of either strut; it stays in place when that is at least
# 2 pi² E I/l³ (G. Winter, Lateral bracing of columns and beams, Transactions ASCE 125 (1960) 807): for
# walls when l is 3.5 thicknesses or more, for round struts 3.0 diameters.
STRAIGHT = math.radians(30.0)


def columns(frame: FrameProblem) -> Int[np.ndarray, " struts"]:
    """Number of the column that each strut is part of, from 0 in the order of their first struts.

    A column ends where more than two struts meet or one ends, where two meet at a corner of more than 30
    degrees, at joints of a skin or a coupling, and where supports leave no motion across it. Struts
    that turn little by little, as an arch in pieces, are one column. As long as all of its pieces,
    its Euler load is then on the safe side: an arch of arc length S and opening angle 2 alpha between two
    hinges carries a thrust of E I (4 pi² - 4 alpha²)/S² (S. P. Timoshenko, J. M. Gere, Theory of
    Elastic Stability, 2nd ed., section 7.3), up to half a circle at least three times pi² E I/S².

    Args:
        frame: its struts, supports, skin and couplings.
    """
    n = len(frame.struts)
    joint, first, second = _inner_joints(frame)
    toward = [_directions(frame, strut, joint) for strut in (first, second)]
    straight = -np.einsum("ni,ni->n", *toward) >= math.cos(STRAIGHT)
    goes_on = straight & _moves_across(frame, joint, toward[0])
    pairs = np.ones(int(goes_on.sum())), (first[goes_on], second[goes_on])
    label = connected_components(coo_array(pairs, shape=(n, n)), directed=False)[1]
    return label.astype(np.int64)


def _inner_joints(
    frame: FrameProblem,
) -> tuple[
    Int[np.ndarray, " joints"],
    Int[np.ndarray, " joints"],
    Int[np.ndarray, " joints"],
]:
    """Joints at which two struts meet and nothing else, and the two struts of each."""
    ends = frame.struts.ravel()
    valence = np.bincount(ends, minlength=len(frame.joints))
    others = [coupling.links for coupling in frame.couplings]
    if frame.skin is not None:
        others.append(frame.skin.triangles)
    for nodes in others:
        valence[nodes] = 0
    joint = np.flatnonzero(valence == 2)
    # The struts of each joint follow each other.
    order = np.argsort(ends, kind="stable")
    start = np.searchsorted(ends[order], joint)
    first, second = order[start] // 2, order[start + 1] // 2
    return joint, first, second


def _directions(
    frame: FrameProblem, strut: Int[np.ndarray, " struts"], joint: Int[np.ndarray, " struts"]
) -> Float[np.ndarray, "struts 3"]:
    """Unit vectors from a joint of each strut to its other one."""
    other = frame.struts[strut].sum(axis=1) - joint
    arm = frame.joints[other] - frame.joints[joint]
    return arm / np.linalg.norm(arm, axis=1, keepdims=True)


def _moves_across(
    frame: FrameProblem,
    joint: Int[np.ndarray, " joints"],
    along: Float[np.ndarray, "joints 3"],
) -> Bool[np.ndarray, " joints"]:
    """Which joints their supports let move at right angles to a direction.

    Of two free directions some combination is across any third. One that is not quite across holds the
    joint as a corner of twice the angle does.
    """
    free = ~frame.fixed[joint, :3]
    slanted = np.abs(np.where(free, along, 0.0)).sum(axis=1) > math.sin(STRAIGHT / 2)
    return np.where(free.sum(axis=1) == 1, ~slanted, free.any(axis=1))
