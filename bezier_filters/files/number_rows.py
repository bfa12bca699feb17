"""Rows of numbers in text files, counted in blocks of bytes without Python objects for lines.

Reading a mesh takes about 50 ns per byte of text; this takes 2. It counts rows and numbers and detects characters that
no number has; `file_contents` finds the exact fault.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bezier_filters.arrays import BoolArray, IntArray

_TEXT_BLOCK_BYTES = 1 << 20
_MAX_INDEX_DIGITS = 9  # more digits may overflow 32 bits
# classes of characters
_DIGIT, _SIGN, _POINT, _EXPONENT, _SLASH, _OTHER, _SPACE, _NEWLINE = range(8)
_CLASSES = bytearray([_OTHER] * 256)
for _class, _characters in {
    _DIGIT: b"0123456789",
    _SIGN: b"+-",
    _POINT: b".",
    _EXPONENT: b"eE",
    _SLASH: b"/",
    _SPACE: b" \t\r\v\f",
    _NEWLINE: b"\n",
}.items():
    for _character in _characters:
        _CLASSES[_character] = _class
_TABLE = bytes(_CLASSES)
# marks pairs of consecutive classes that no number has, at 8 times the first plus the second
_ENDS = (_SLASH, _SPACE, _NEWLINE)
_NO_PAIRS = bytearray(256)
for _class, _others in {
    _DIGIT: (_SIGN,),
    _SIGN: (_SIGN, _EXPONENT, *_ENDS),
    _POINT: (_SIGN, _POINT),
    _EXPONENT: (_POINT, _EXPONENT, *_ENDS),
    **dict.fromkeys(_ENDS, (_EXPONENT,)),
}.items():
    for _other in _others:
        _NO_PAIRS[8 * _class + _other] = 1
_PAIRS = bytes(_NO_PAIRS)
_BETWEEN = bytes([_DIGIT, _SIGN, _SLASH, _OTHER])
_TWICE = [bytes(pair) for pair in ((_POINT, _POINT), (_EXPONENT, _POINT), (_EXPONENT, _EXPONENT))]
_INDENTATION = re.compile(rb"^[ \t]+", re.MULTILINE)


@dataclass(frozen=True)
class TextBlock:
    """Whole lines of a text file; `classes` has a class for each byte."""

    text: bytes
    classes: np.ndarray[tuple[int], np.dtype[np.uint8]]
    starts: NDArray[np.intp]  # offset of the first byte of each line

    def __len__(self) -> int:
        """Number of lines."""
        return len(self.starts)

    @property
    def heads(self) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
        """First two bytes of each line, (lines, 2); the second may be the first of the next line."""
        content = np.frombuffer(self.text, np.uint8)
        return np.stack([content[self.starts], content[np.minimum(self.starts + 1, len(content) - 1)]], axis=1)

    def word_starts(self) -> BoolArray:
        """Mask of the first bytes of words."""
        is_space = self.classes >= _SPACE
        result = ~is_space
        result[1:] &= is_space[:-1]
        return result

    def word_count(self) -> int:
        """Number of words."""
        return int(np.count_nonzero(self.word_starts()))

    def words_per_line(self) -> IntArray:
        """Number of words of each line."""
        sums = np.concatenate([[0], np.cumsum(self.word_starts(), dtype=np.int32)])
        result: IntArray = np.diff(sums[np.append(self.starts, len(self.text))])
        return result

    def has_odd(self, is_looked_at: BoolArray | None = None, *, integers: bool = False, heads: int = 0) -> bool:
        """Whether any word in some lines is not a number, not counting `heads` characters at the start of each line.

        Integers may have slashes between them, but no point, no exponent and at most nine digits.
        """
        is_odd = self.classes == _OTHER
        if integers:
            is_odd |= (self.classes == _POINT) | (self.classes == _EXPONENT)
        else:
            is_odd |= self.classes == _SLASH
        is_odd |= self._is_misspelt()
        for k in range(heads):
            is_odd[np.minimum(self.starts + k, len(is_odd) - 1)] = False
        places = np.flatnonzero(is_odd)
        if len(places) and is_looked_at is not None:
            places = places[is_looked_at[np.searchsorted(self.starts, places, side="right") - 1]]
        return bool(len(places)) or (integers and self.has_long_number())

    def _is_misspelt(self) -> BoolArray:
        """Mask of signs, points and exponents at places where no number has them."""
        pairs = self.classes.copy()  # each class with the one before, and an end behind the last
        pairs[1:] += 8 * self.classes[:-1]
        pairs[:1] += 8 * _NEWLINE
        result = np.frombuffer(bytearray(pairs.tobytes().translate(_PAIRS)), np.bool_)
        result[-1:] |= np.isin(self.classes[-1:], (_SIGN, _EXPONENT))
        # A number has at most one point, before at most one exponent.
        left = self.classes.tobytes().translate(None, _BETWEEN)
        if any(pair in left for pair in _TWICE):
            places = np.flatnonzero((self.classes == _POINT) | (self.classes == _EXPONENT) | (self.classes >= _SPACE))
            kinds = self.classes[places]
            wrong = (kinds[1:] <= _EXPONENT) & (
                (kinds[:-1] == _EXPONENT) | ((kinds[:-1] == _POINT) & (kinds[1:] == _POINT))
            )
            result[places[1:][wrong]] = True
        return result

    def has_long_number(self) -> bool:
        """Whether there are more consecutive digits than in any index."""
        run, length = self.classes <= _SIGN, 1
        while length <= _MAX_INDEX_DIGITS and len(run):
            step = min(length, _MAX_INDEX_DIGITS + 1 - length)
            run, length = run[:-step] & run[step:], length + step
        return bool(run.any())

    def integers(self) -> NDArray[np.int64]:
        """The integers, of at most nine digits, in order, except after a slash."""
        content, is_digit = np.frombuffer(self.text, np.uint8), self.classes == _DIGIT
        is_last = is_digit.copy()
        is_last[:-1] &= ~is_digit[1:]
        places = np.flatnonzero(is_last)
        numbers, power = np.zeros(len(places), np.int64), 1
        rest = np.arange(len(places))  # numbers with more digits, which are read backwards
        while len(rest):
            numbers[rest] += power * (content[places[rest]].astype(np.int64) - ord("0"))
            places[rest] -= 1
            power *= 10
            rest = rest[(places[rest] >= 0) & is_digit[places[rest]]]
        before = np.where(places >= 0, content[places], ord(" "))
        numbers[before == ord("-")] *= -1
        result: NDArray[np.int64] = numbers[before != ord("/")]
        return result

    def lines(self, first: int, last: int) -> "TextBlock":
        """Lines first .. last-1."""
        begin, end = (int(self.starts[k]) if k < len(self) else len(self.text) for k in (first, last))
        return TextBlock(self.text[begin:end], self.classes[begin:end], self.starts[first:last] - begin)

    def chosen(self, is_chosen: BoolArray) -> "TextBlock":
        """The lines of a mask (lines,)."""
        if is_chosen.all():
            return self
        ends = np.append(self.starts[1:], len(self.text))
        sizes = ends - self.starts
        text = np.frombuffer(self.text, np.uint8)[np.repeat(is_chosen, sizes)].tobytes()
        return _block(text)

    def rows(self) -> "TextBlock":
        """The lines except empty ones and comments."""
        return self.chosen(~np.isin(self.heads[:, 0], np.frombuffer(b"#\r\n\v\f", np.uint8)))


def text_blocks(path: Path, offset: int = 0, *, continued: bool = False, commas: bool = False) -> Iterator[TextBlock]:
    """A text file from an offset on, in blocks of whole lines.

    If lines may be `continued`, a backslash at the end of a line and the line end count as spaces; with `commas`, so
    do commas.
    """
    with path.open("rb") as stream:
        stream.seek(offset)
        rest = b""
        while data := stream.read(_TEXT_BLOCK_BYTES):
            data = rest + (data.replace(b",", b" ") if commas else data)
            end = data.rfind(b"\n") + 1
            while continued and end and data[:end].rstrip(b"\r\n").endswith(b"\\"):
                end = data.rfind(b"\n", 0, end - 1) + 1
            rest = data[end:]
            if end:
                yield _block(_join_lines(data[:end]) if continued else data[:end])
        if rest:
            yield _block(_join_lines(rest) if continued else rest)


def _join_lines(text: bytes) -> bytes:
    return text.replace(b"\\\r\n", b"   ").replace(b"\\\n", b"  ") if b"\\" in text else text


def _block(text: bytes) -> TextBlock:
    content, classes = np.frombuffer(text, np.uint8), np.frombuffer(text.translate(_TABLE), np.uint8)
    ends = np.flatnonzero(classes == _NEWLINE) + 1
    starts = np.concatenate([[0], ends[ends < len(text)]]) if text else ends
    first = content[starts]
    if ((first == ord(" ")) | (first == ord("\t"))).any():
        return _block(_INDENTATION.sub(b"", text))
    return TextBlock(text, classes, starts)


def sections(blocks: Iterator[TextBlock], counts: list[int]) -> Iterator[tuple[int, TextBlock]]:
    """Rows of sections with given counts, in pieces, after the index of the section.

    Rows after the last section have the index ``len(counts)``.
    """
    index, left = 0, counts[0] if counts else 0
    for block in blocks:
        rows, done = block.rows(), 0
        while done < len(rows):
            while index < len(counts) and not left:
                index += 1
                left = counts[index] if index < len(counts) else 0
            step = min(left, len(rows) - done) if index < len(counts) else len(rows) - done
            yield index, rows.lines(done, done + step)
            done, left = done + step, left - step
