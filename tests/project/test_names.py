"""Names and words of the package: one meaning for each constant, functions named by verbs or nouns, plain English."""

import ast
import io
import re
import tokenize
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

import bezier_filters

PACKAGE = Path(bezier_filters.__file__).parent
PREPOSITIONS = frozenset(
    ["with", "without", "from", "in", "on", "of", "to", "by", "as", "at", "around", "beyond", "along", "onto", "across"]
)
"""First words of names that say how something is done, and not what."""
ALLOWED = {
    "closed_components": "a term of topology: components without a border",
    "punched_patch": "public",
    "centred": "public: a constructor of ParameterRectangle",
    "of": "public: rows of Rows",
    "of_kind": "public: lines of Creases",
    "of_grade": "public: a constructor of FitStatus",
    "from_level_set": "public: a constructor of SampledSurface",
    "to_local": "public: a change of coordinates",
    "to_world": "public: a change of coordinates",
    "to_dict": "public: a conversion",
    "to_open3d": "public: a conversion",
    "to_pandas": "public: a conversion",
    "to_pyvista": "public: a conversion",
    "to_trimesh": "public: a conversion",
    "on_start": "protocol: numba.core.event.Listener",
    "on_end": "protocol: numba.core.event.Listener",
}
"""Functions that are named by a participle or begin with a preposition, and why."""
DIALECT = re.compile(
    r"\b(anew|those that|that which|what is (?:off|left|there|told|taken)|as far as|is told|are told|tells? (?:of|that)"
    r"|beside(?!s)|for nothing|that is off|which is off|by lot|unlike before)\b",
    re.IGNORECASE,
)
"""Turns of phrase that stand for a noun or a term of the field; reported is the word, not told."""


def read_package():
    """Path from the package and text of every module."""
    return {
        path.relative_to(PACKAGE).as_posix(): path.read_text(encoding="utf-8") for path in sorted(PACKAGE.rglob("*.py"))
    }


def is_numeric(node):
    """Whether an expression consists of numbers, or computes with a number."""
    numbers = [n for n in ast.walk(node) if isinstance(n, ast.Constant) and type(n.value) in (int, float)]
    computes = ast.Constant | ast.UnaryOp | ast.BinOp | ast.Call | ast.Tuple | ast.List | ast.Dict
    return bool(numbers) and isinstance(node, computes)


syntax_tree = cache(ast.parse)


def constant_values(sources):
    """Values of every numeric constant at the top of a module, by name and module."""
    values = defaultdict(dict)
    for module, text in sources.items():
        for node in syntax_tree(text).body:
            if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None or not is_numeric(node.value):
                continue
            for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                names = [name.id for name in ast.walk(target) if isinstance(name, ast.Name) and name.id.isupper()]
                for place, name in enumerate(names):
                    values[name][module] = f"{ast.unparse(node.value)}, place {place}"
    return values


def ambiguous_constants(sources):
    """Names of constants with several values."""
    return {name: found for name, found in constant_values(sources).items() if len(set(found.values())) > 1}


def unclear_functions(sources):
    """Functions named by a participle or beginning with a preposition; properties are attributes."""
    found = []
    for module, text in sources.items():
        for node in ast.walk(syntax_tree(text)):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            first = node.name.strip("_").split("_")[0]
            is_property = any(
                getattr(each, "id", "") in ("property", "cached_property") for each in node.decorator_list
            )
            is_participle = len(first) > 4 and first.endswith("ed") and not first.endswith("eed")
            if first in PREPOSITIONS or (is_participle and not is_property):
                found.append((module, node.name))
    return found


def dialect_phrases(sources):
    """Phrases of the dialect in docstrings and comments, with their modules."""
    found = []
    for module, text in sources.items():
        prose = [t.string for t in tokenize.generate_tokens(io.StringIO(text).readline) if t.type == tokenize.COMMENT]
        for node in ast.walk(syntax_tree(text)):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                prose.append(ast.get_docstring(node) or "")
        found += [
            (module, match.group().lower()) for part in prose for match in DIALECT.finditer(" ".join(part.split()))
        ]
    return found


@pytest.fixture(scope="module")
def sources():
    return read_package()


def test_every_constant_has_one_value(sources):
    assert len(constant_values(sources)) > 300
    assert ambiguous_constants(sources) == {}


def test_functions_are_named_by_verbs_or_nouns(sources):
    unclear = unclear_functions(sources)
    assert [(module, name) for module, name in unclear if name not in ALLOWED] == []
    assert ALLOWED.keys() - {name for _, name in unclear} == set(), "names that are gone need no exception"


def test_docstrings_and_comments_have_no_dialect(sources):
    assert dialect_phrases(sources) == []


def test_unclear_names_are_found():
    example = {
        "a.py": "STEPS = 3\nLIMIT = 2.0\nKIND = 'a'\n",
        "b.py": "STEPS = 4\nLIMIT = 2.0\nKIND = 'b'\n\ndef _moved(points):\n    pass\n\ndef need(a):\n    pass\n",
        "c.py": "STEPS: int = 3\n\nclass Mesh:\n    @property\n    def rounded(self):\n        pass\n"
        "    def with_normals(self):\n        '''Those that are told,\n        anew.'''  # taken by lot\n",
    }
    assert ambiguous_constants(example).keys() == {"STEPS"}
    assert unclear_functions(example) == [("b.py", "_moved"), ("c.py", "with_normals")]
    assert sorted(phrase for _, phrase in dialect_phrases(example)) == ["anew", "are told", "by lot", "those that"]
