"""The deviation of a page: its fields, what a person decides by, and the regions that deviate."""

from collections.abc import Mapping
from dataclasses import dataclass

from bezier_filters.arrays import BoolArray, FloatArray, Report
from bezier_filters.display import TOLERANCES_SHOWN
from bezier_filters.fields import DEVIATION, columns
from bezier_filters.inspection.deviation import Deviation
from bezier_filters.inspection.deviation_status import DeviationStatus
from bezier_filters.pictures.verdict import Sentence

NOT_COMPARED = "not compared"
MAX_PAGE_REGIONS = 100  # rows of the table of regions
_MEASURED = {"surface": "the surface that is fitted to it", "points": "its points"}


@dataclass(frozen=True)
class DeviationFields:
    """Columns of the deviation of a mesh, from the arrays of a result or from a mesh that holds them."""

    values: Mapping[str, FloatArray]  # by column
    tolerance: float | None  # a length

    @property
    def compared(self) -> BoolArray:
        """Vertices that have a deviation, (n,)."""
        compared: BoolArray = self.values["bz_deviation_grade"] >= DeviationStatus.ON_FACE.grade
        return compared

    @property
    def limits(self) -> tuple[float, float] | None:
        """Ends of the colours of inspection, which a tolerance has."""
        return (
            None if self.tolerance is None else (-TOLERANCES_SHOWN * self.tolerance, TOLERANCES_SHOWN * self.tolerance)
        )


def deviation_fields(found: Deviation) -> DeviationFields:
    """Columns of a result."""
    return DeviationFields(columns(DEVIATION, found), found.tolerance)


def deviation_sentences(report: Report, reference: str) -> list[Sentence]:
    """Sentences on the report of the filter: how far the mesh is, where it deviates, and what stands in the way."""
    if not report["compared"]:
        return [(f"Nothing was compared: {text}.", "") for text in report["warnings"]]
    sentences = [
        f"The root mean square deviation from {reference} is {report['rms']:.3g}, the mean {report['mean']:.3g}."
    ]
    if report["share_within"] is not None:
        share = f"{report['share_within']:.2%}"
        sentences[0] += f" {share} is within the tolerance of {report['tolerance']:.4g}."
    regions = report["regions"]
    if report["share_significant"] is None:
        sentences.append("What of it is noise is not known, because the noise could not be learned.")
    elif not regions:
        sentences.append("No region deviates by more than noise explains.")
    else:
        first, count = regions[0], len(regions)
        place = ", ".join(f"{x:.4g}" for x in first["place"])
        deviates = "1 region deviates" if count == 1 else f"{count:,} regions deviate"
        largest = "It is" if count == 1 else "The most significant one is"
        sentences.append(
            f"{deviates} by more than noise explains. {largest} around ({place}), with a mean of "
            f"{first['deviation']:.3g} ± {first['std']:.2g} over {first['vertices']:,} vertices."
        )
    remarks = [f"{remark[0].upper()}{remark[1:]}." for remark in report["remarks"]]
    return [(text, "") for text in [*sentences, *remarks]]


def deviation_tables(report: Report) -> list[Report]:
    """Tables of the comparison and of the regions that deviate, for a page."""
    facts: list[list[object]] = [["compared", report["compared"]], ["by", _MEASURED[report["measured"]]]]
    facts += [[DeviationStatus[name].message, count] for name, count in report["status"].items()]
    for name in ("lowest", "highest"):
        if report[name] is not None:
            facts.append([f"{name} deviation", report[name]["deviation"]])
            facts.append(["its standard error", report[name]["std"]])
    facts += [
        [name.replace("_", " "), report[name]] for name in ("noise", "reference_noise") if report[name] is not None
    ]
    tables: list[Report] = [{"title": "The comparison", "header": ["quantity", "value"], "rows": facts}]
    if report["regions"]:
        rows = [
            [region["vertices"], region["deviation"], region["std"], region["p_value"], *region["place"]]
            for region in report["regions"][:MAX_PAGE_REGIONS]
        ]
        more = f", the {MAX_PAGE_REGIONS} most significant" if len(report["regions"]) > MAX_PAGE_REGIONS else ""
        header = ["vertices", "mean deviation", "standard error", "p-value", "x", "y", "z"]
        title = f"Regions that deviate: {len(report['regions']):,}{more}"
        places = [region["place"] for region in report["regions"][:MAX_PAGE_REGIONS]]
        tables.append({"title": title, "header": header, "rows": rows, "places": places})
    return tables
