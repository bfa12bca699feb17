"""Outcome of the fit at each vertex: a code for every fallback, and a grade in files and on meshes."""

from enum import IntEnum


class MessageEnum(IntEnum):
    """Codes with messages."""

    message: str

    def __new__(cls, code: int, message: str) -> "MessageEnum":
        """Make a member of a code and its message."""
        member = int.__new__(cls, code)
        member._value_ = code
        member.message = message
        return member


class FitStatus(MessageEnum):
    """Outcome of the fit at one vertex, from the best (0) to the worst.

    Codes up to `FOLDED` come with an estimate of every quantity; from `NORMAL_ONLY` on,
    the quantities that could not be estimated hold the fill value 0.

    Meshes and files hold the `grade` instead, from 9 for `OK` down to 0 for `SKIPPED`: other programs give the
    value 0 to vertices that they add, and nothing was estimated there.

    Pass ``int(FitStatus.OK)`` to NumPy: with a member, it looks up attributes in Python and may lose a Ctrl-C.

    >>> FitStatus.WIDER_RING.message
    'fitted on more rings than most: too few or badly placed points, as at a boundary'
    >>> FitStatus.OK.grade, FitStatus.FOLDED.grade, FitStatus.SKIPPED.grade
    (9, 3, 0)
    >>> FitStatus.of_grade(9).name
    'OK'
    """

    OK = 0, "fitted as asked"
    WIDER_RING = 1, "fitted on more rings than most: too few or badly placed points, as at a boundary"
    NARROWER_RING = 2, "fitted on fewer rings than most: the wider ones fold in the projection"
    OTHER_PLANE = 3, "fitted over another plane: the projection along the vertex normal folds"
    ONE_RING = 4, "fitted on the 1-ring, mostly by a quadratic: wider neighbourhoods fold in every plane"
    LOWER_DEGREE = 5, "quadratic fit: too few or badly placed points for the patch asked for"
    FOLDED = 6, "quadratic fit of a folded neighbourhood: unreliable"
    NORMAL_ONLY = 7, "normal of the faces or nearest points; no curvature: its points determine none"
    ISOLATED = 8, "no face with an area, here or at a neighbour, or points on a line: nothing estimated"
    SKIPPED = 9, "not selected, or added by another program: nothing estimated"

    @property
    def has_curvature(self) -> bool:
        """Whether curvature and torsion at this vertex are estimates, not fill values."""
        return self <= FitStatus.FOLDED

    @property
    def words(self) -> str:
        """The outcome in a few words, for legends."""
        return self.message.partition(":")[0]

    @property
    def grade(self) -> int:
        """Number of this outcome in the column ``bz_fit_grade``; higher is better."""
        return FitStatus.SKIPPED - self

    @classmethod
    def of_grade(cls, grade: float) -> "FitStatus":
        """Outcome of a number in the column ``bz_fit_grade``; `SKIPPED` if it is no grade."""
        return next((status for status in cls if status.grade == grade), cls.SKIPPED)
