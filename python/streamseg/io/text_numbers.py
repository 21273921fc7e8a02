"""What a number in a text file looks like, and what people write instead."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_NO_VALUE = re.compile(r"[-+]?(nan|inf|infinity)", re.IGNORECASE)

_LONGEST_LOOKED_AT = 10_000

# In the order in which they are tried: 1,000,000 is no decimal comma, 1,5 is.
_FOREIGN = (
    (r"[-+]?\d{1,3}((,\d{3})+\.\d*|(,\d{3}){2,})", "commas between thousands", "1234.5, without them"),
    (r"[-+]?\d{1,3}(\.\d{3})+,\d+", "points between thousands", "1234.5, with one point"),
    (r"[-+]?\d+,\d+([eE][-+]?\d+)?", "decimal commas", "1.5, with a point (and semicolons between columns)"),
    (r"[-+]?(\d+\.?\d*|\.\d+)[dDqQ][-+]?\d+", "exponents other than e", "1.5e3"),
    (r"[-+]?\d+(_\d+)+(\.\d*)?", "underscores", "1234.5"),
    (r"[-+]?0[xX][0-9a-fA-F.]+([pP][-+]?\d+)?", "hexadecimal digits", "1234.5"),
)


def is_number(text: str) -> bool:
    """Tell whether it is a number as it is read: 1, -1.5, .5, 1e-3."""
    return _NUMBER.fullmatch(text) is not None


def is_value(text: str) -> bool:
    """Tell whether it is a number, or says that there is none: nan, inf."""
    return is_number(text) or _NO_VALUE.fullmatch(text) is not None


def split(line: str, delimiter: str | None) -> list[str]:
    """Take a line of values apart; what is quoted is one of them."""
    return [part.strip() for part in unquoted(line).split(delimiter)]


def unquoted(text: str) -> str:
    """Take the quotes from around values. Quoted words that could not stand without quotes become one word."""
    return re.sub(r'"([^"\n]*)"', _without_quotes, text) if '"' in text else text


def hint(line: str) -> str:
    """Say how to write numbers that are not read as they stand; empty if there are none of a known kind."""
    line = line[:_LONGEST_LOOKED_AT]
    quoted = re.findall(r'"([^"]*)"', line)
    parts = [part.strip("\"'") for part in re.split(r"[;\s]+", line)]
    # Where there is nothing but commas, they stand between columns.
    tokens = [*quoted, *(parts if len(parts) > 1 else ()), *line.split(",")]
    for pattern, kind, right in _FOREIGN:
        if any(re.fullmatch(pattern, token.strip(), re.ASCII) for token in tokens):
            return f"; numbers with {kind} are not read: write {right}"
    return ""


def has_split_decimals(lines: Sequence[str]) -> bool:
    """Tell whether columns between commas are surely halves of numbers with decimal commas: 26,090 for 26.09.

    No whole number is written with a 0 in front, but decimals are.
    """
    pairs = _halves(lines)
    return any(_has_zero_in_front(after) for _, after in pairs) and not any(
        _has_zero_in_front(before) for before, _ in pairs
    )


def may_have_split_decimals(lines: Sequence[str]) -> bool:
    """Tell whether they may be: in some lines, all are whole, and every second has the same number of digits."""
    pairs = _halves(lines)
    return len(lines) > 1 and len({len(after) for _, after in pairs}) == 1


def _halves(lines: Sequence[str]) -> list[tuple[str, str]]:
    """Pairs of columns that could be x, y and z with decimal commas; none if a line says otherwise."""
    pairs: list[tuple[str, str]] = []
    for line in lines:
        parts = split(line, ",")
        befores, afters = parts[:6:2], parts[1:6:2]
        if len(parts) < 6 or not all(re.fullmatch(r"[-+]?\d+", part, re.ASCII) for part in befores):
            return []
        if not all(re.fullmatch(r"\d+", part, re.ASCII) for part in afters):
            return []
        pairs += zip(befores, afters, strict=True)
    return pairs


def _has_zero_in_front(digits: str) -> bool:
    return re.match(r"[-+]?0\d", digits) is not None


def _without_quotes(quoted: re.Match[str]) -> str:
    value: str = quoted[1].strip()
    return value if re.fullmatch(r"[^\s,;]+", value) else "quoted"
