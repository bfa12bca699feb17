"""How a vertex was compared with a reference surface."""

from bezier_filters.status import MessageEnum


class DeviationStatus(MessageEnum):
    """How the deviation of one vertex was found, from the best (0) to the worst.

    Codes up to `ON_FACE` come with a deviation; the others have the fill value 0. As with `FitStatus`, meshes and files
    hold the `grade`, which is 0 for vertices that other programs add.

    >>> DeviationStatus.PAST_BORDER.message
    'past the border of the reference, which is the nearest place'
    >>> DeviationStatus.OK.grade, DeviationStatus.SKIPPED.grade
    (8, 0)
    """

    OK = 0, "compared as asked"
    POINT = 1, "by the vertex itself, where its mesh has no patch"
    ON_FACE = 2, "against a face of the reference, which has no patch there"
    PAST_BORDER = 3, "past the border of the reference, which is the nearest place"
    OPPOSITE = 4, "the nearest place of the reference faces the other way, as the other side of a wall does"
    TOO_FAR = 5, "farther from the reference than the largest distance asked for"
    NOT_CONVERGED = 6, "no nearest place was found"
    ISOLATED = 7, "no normal: in no face with an area"
    SKIPPED = 8, "not selected, or added by another program"

    @property
    def grade(self) -> int:
        """Number of this outcome in the column ``bz_deviation_grade``; higher is better."""
        return DeviationStatus.SKIPPED - self
