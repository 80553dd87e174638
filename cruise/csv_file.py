"""Recordings as CSV files: a header line that names the columns, then one line a sample.

Where something else separates the cells, a comma is the decimal sign. Times are seconds, stamps as ISO 8601 has them,
or those of a clock, beside any date. Lines before the header are passed over, and a line of units below it is read as
if they stood in brackets behind the names. The text is UTF-8, UTF-16 with its mark at the beginning, or else
Windows-1252; what a power failure left behind its end is none.
"""

import codecs
import csv
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from cruise.columns import TIME, RecordingSettings, column_of, tabulated, time_of
from cruise.recording import Recording, RecordingError, listed
from cruise.sampling import FloatArray
from cruise.settings import replaced
from cruise.units import apart, unit_of

DIGITS: Final = (
    9  # of a value that is written: a position in degrees is then right to 0.1 m, any sensor's reading whole
)
TIME_DECIMALS: Final = 9  # of s: a period of 1/30 s comes back as one
STAMP: Final = re.compile(
    r"(\d{4}-\d\d-\d\d[T ]\d\d:\d\d(?::\d\d(?:\.\d{1,6})?)?)(?:(?<=\.\d{6})\d+)?(?:Z|([+-]\d\d)(?::?(\d\d))?)?"
)
"""ISO 8601 to the microsecond, and how far its clock is ahead of UTC in h and min."""
CLOCK: Final = re.compile(r"(?:[\d./-]+[ T]+)?(\d{1,2}):([0-5]\d):([0-5]\d(?:\.\d*)?)(?: ?([AP])M)?", re.IGNORECASE)
"""Time of a day, with or without a date before it: h, min, s, and the half of the day."""
DAY_S: Final = 86400.0
MOST_BEFORE: Final = 100  # lines among which the header is
FEWEST_CELLS: Final = 3  # of a row: a time, an input and an output
KNOWN_UNITS: Final = 2  # by which a line of units is told
SAMPLED: Final = 50  # lines of the middle of a file that tell what its rows are like


def read_csv(path: str | Path, settings: RecordingSettings, dt_s: float | None = None) -> Recording:
    """Read a CSV file onto a uniform grid of `dt_s` (default: the file's own step, rounded to a sensible number).

    Raises RecordingError with file, line or column and what to do.
    """
    notes: list[str] = []
    lines, before = _table(_lines(path, notes), notes)
    delimiter, at = _delimiter(lines), f"{path}:{before + 1}"
    if delimiter != ",":
        lines = [*lines[:1], *(line.replace(",", ".") for line in lines[1:])]
    table = _plain_numbers(lines, delimiter)
    if table is not None:
        header, _ = _read_rows(path, lines[:1], delimiter, before)
        raw = dict(zip(header, table.T, strict=True))
        return tabulated(str(path), raw, settings, dt_s, lambda row: f"{path}:{before + row + 2}", at, tuple(notes))
    header, rows = _read_rows(path, lines, delimiter, before)
    raw = {name: numbers([row[index] for _, row in rows]) for index, name in enumerate(header)}
    time = column_of(time_of(raw, settings, []), header, settings)
    if time in raw and np.isnan(raw[time]).all():
        raw[time] = _times_s([row[header.index(time)].strip() for _, row in rows], notes)
    return tabulated(str(path), raw, settings, dt_s, lambda row: f"{path}:{rows[row][0]}", at, tuple(notes))


def header_of(path: str | Path) -> list[str]:
    """Return the names of a CSV file's columns. Raises RecordingError where it has none."""
    lines, before = _table(_lines(path, []), [])
    return _read_rows(path, lines[:2], _delimiter(lines), before)[0]


def write_csv(recording: Recording, path: str | Path) -> None:
    """Write a recording as CSV, without the digits that arithmetic made; what was not measured is an empty cell."""
    names = list(recording.columns)
    times_s = np.round(recording.time_s, TIME_DECIMALS).tolist()
    columns = [[float(f"{value:.{DIGITS}g}") for value in recording.columns[name].tolist()] for name in names]
    table = zip(times_s, *columns, strict=True)
    with replaced(path, newline="") as stream:  # half a table would look like a whole, shorter one
        writer = csv.writer(stream)
        writer.writerow([TIME, *names])
        writer.writerows([["" if value != value else value for value in row] for row in table])


def _lines(path: str | Path, notes: list[str]) -> Sequence[str]:
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError as error:
        raise RecordingError(f"{path}: no such file") from error
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    utf = "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"
    try:
        text = data.decode(utf)
    except UnicodeDecodeError as error:
        try:
            text = data.decode("cp1252")
        except UnicodeDecodeError:
            line = data.count(b"\n", 0, error.start) + 1
            raise RecordingError(
                f"{path}:{line}: neither UTF-8 nor Windows-1252; if it is a CSV file, save it again as CSV in UTF-8"
            ) from error
        notes.append("not UTF-8 text, read as Windows-1252")
    written = text.rstrip("\0")
    if "\0" in written:
        raise RecordingError(f"{path}: not text but binary data; export the recording as a CSV file")
    if len(written) < len(text):
        notes.append(
            f"ends in {len(text) - len(written)} characters of nothing, as after a power failure; read up to there"
        )
    return _spaced(written.splitlines())


def _spaced(lines: Sequence[str]) -> Sequence[str]:
    """The lines with tabs between their cells, where nothing but spaces is, as numpy writes them."""
    middle = lines[len(lines) // 2 :][:SAMPLED]
    cells = [line.split() for line in middle if line.strip()]
    plain = cells and all(len(row) >= FEWEST_CELLS and all(map(_is_value, row)) for row in cells)
    if not plain or any(one in line for line in middle for one in "\t;,"):
        return lines
    return ["\t".join(line.lstrip("# ").split()) for line in lines]


def _table(lines: Sequence[str], notes: list[str]) -> tuple[Sequence[str], int]:
    """The lines from the header on, and how many stand before it: what a logger says of itself.

    The header is the last line without a value that names as many columns as the rows have cells.
    """
    for delimiter in "\t;,":
        most = max((_filled(line, delimiter) for line in lines[len(lines) // 2 :][:SAMPLED]), default=0)
        if most < FEWEST_CELLS:
            continue
        first = [[cell.strip(' "') for cell in line.split(delimiter)] for line in lines[:MOST_BEFORE]]
        full = [sum(map(bool, cells)) >= most for cells in first]
        values = [sum(map(_is_value, cells)) for cells in first]
        headers = [k for k, cells in enumerate(first) if full[k] and not values[k] and not _are_units(cells)]
        before = headers[-1] if headers else 0
        if any(full[k] and values[k] > 0.5 * most for k in range(before)):  # a row: what comes behind is no header
            before = 0
        if before:
            notes.append(f"{before} lines stand before the header, passed over")
        return lines[before:], before
    return lines, 0


def _filled(line: str, delimiter: str) -> int:
    return sum(bool(cell.strip()) for cell in line.split(delimiter))


def _is_value(text: str) -> bool:
    """Whether a cell holds a number or a time."""
    meanings = (_number(text.replace(",", ".")), _clock_s(text), _stamp_s(text))
    return not all(map(math.isnan, meanings))


def _are_units(cells: Sequence[str]) -> bool:
    """Whether cells are the units of columns: two that are known at least, and none is a value."""
    return sum(bool(unit_of(cell)) for cell in cells) >= KNOWN_UNITS and not any(map(_is_value, cells))


def _delimiter(lines: Sequence[str]) -> str:
    """What stands as often in the first row as in the header, where names or numbers may hold commas; else the most."""
    header, row = [*lines[:2], "", ""][:2]
    alike = [one for one in "\t;," if 0 < header.count(one) == row.count(one)]
    return alike[0] if alike else max(",;\t", key=header.count)


def _plain_numbers(lines: Sequence[str], delimiter: str) -> FloatArray | None:
    """Return the cells (N, columns) of a table whose every line holds numbers or nothing; None for any other.

    It is twice as fast as cell by cell, which the rest needs: quotes, words, lines that are short or empty.
    """
    if len(lines) < 2 or not all(map(str.strip, lines)):
        return None
    body = "\n".join(["", *lines[1:], ""])
    for before, after in ((delimiter, delimiter), (delimiter, delimiter), (delimiter, "\n"), ("\n", delimiter)):
        body = body.replace(before + after, f"{before}nan{after}")
    try:
        table = np.loadtxt(body.splitlines()[1:], delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:
        return None
    if table.shape != (len(lines) - 1, lines[0].count(delimiter) + 1):
        return None
    known = np.isfinite(table)
    return np.where(known, table, np.nan) if known.any(axis=1).all() else None


def _read_rows(
    path: str | Path, lines: Sequence[str], delimiter: str, before: int
) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """Return the header, with the units of a line below it, and the rows, as long as it, with their line numbers."""
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    rows: list[tuple[int, list[str]]] = []
    try:
        names = [name.strip() for name in next(reader, [])]
        names[:1] = [name.lstrip("# ") for name in names[:1]]  # as numpy writes it
        header = [name or f"column {number}" for number, name in enumerate(names, 1)]  # a separator too many at its end
        for row in reader:
            if any(cell.strip() for cell in row[len(header) :]):
                raise RecordingError(
                    f"{path}:{before + reader.line_num}: {len(row)} cells, but the header names {len(header)} columns; "
                    "the first line has to be the header, and a cell that holds the separator in quotes"
                )
            if any(row):
                rows.append((before + reader.line_num, row[: len(header)] + [""] * (len(header) - len(row))))
    except csv.Error as error:
        raise RecordingError(f"{path}:{before + reader.line_num}: {error}; is it a CSV file?") from error
    if not any(names) or all(not math.isnan(_number(name)) for name in names):
        raise RecordingError(f"{path}:1: no header line; the first line has to name the columns")
    if rows and _are_units(rows[0][1]):
        units = [unit_of(cell) for cell in rows.pop(0)[1]]
        header = [
            f"{name} [{unit}]" if unit and name == apart(name)[0] else name
            for name, unit in zip(header, units, strict=True)
        ]
    twice = {name for name in header if header.count(name) > 1}
    if twice:
        raise RecordingError(f"{path}:{before + 1}: several columns are named {listed(sorted(twice))}; rename them")
    return header, rows


def numbers(texts: Sequence[str]) -> FloatArray:
    """Return the cells (N,) as numbers, NaN where a text is none or not finite."""
    try:
        values = np.array(texts, dtype=float)
    except ValueError:  # some cell is empty or text: the slow way
        values = np.array([_number(text) for text in texts])
    return np.where(np.isfinite(values), values, np.nan)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _times_s(texts: Sequence[str], notes: list[str]) -> FloatArray:
    """The times (N,) of stamps, NaN where a text is none: of a clock, which is the same again after a day, from the
    whole second of the first."""
    stamps_s = np.array([_stamp_s(text) for text in texts])
    if not np.isnan(stamps_s).all():
        return stamps_s
    clock_s = np.array([_clock_s(text) for text in texts])
    known = np.flatnonzero(~np.isnan(clock_s))
    if not len(known):
        return clock_s
    clock_s[known] += DAY_S * np.cumsum(np.diff(clock_s[known], prepend=clock_s[known[0]]) < -0.5 * DAY_S)
    notes.append(f"times count from {texts[known[0]]} of its clock, rounded down to the second")
    return clock_s - math.floor(clock_s[known[0]])


def _clock_s(text: str) -> float:
    """The seconds since midnight of a time such as 09:00:00.05, 01.08.2026 09:00:00 or 9:00:00 PM, NaN for none."""
    clock = CLOCK.fullmatch(text.strip())
    if clock is None:
        return math.nan
    hours = int(clock[1]) if clock[4] is None else int(clock[1]) % 12 + 12 * (clock[4] in "pP")
    return 3600.0 * hours + 60.0 * int(clock[2]) + float(clock[3])


def _stamp_s(text: str) -> float:
    """The seconds since 1970 of a stamp such as 2026-08-01T09:00:00.05+02:00, NaN for none; without a zone in UTC."""
    stamp = STAMP.fullmatch(text.strip())
    if stamp is None:
        return math.nan
    hours, minutes = stamp[2] or "+00", stamp[3] or "00"
    try:
        clock_s = 1e-6 * float(np.datetime64(stamp[1], "us").astype(np.int64))
    except ValueError:  # no such day
        return math.nan
    return clock_s - 3600.0 * int(hours) - 60.0 * int(hours[0] + minutes)
