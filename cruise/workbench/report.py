"""The report to take away: one HTML file that holds everything, and the same as PDF."""

import base64
import html
import io
import math
from collections.abc import Iterator
from dataclasses import dataclass

from cruise.workbench import commands
from cruise.workbench.found import Compared, Diagnosed
from cruise.workbench.parts import number, speed
from cruise.workbench.session import Session, Step

STYLE = """
body{font:15px/1.55 system-ui,Roboto,sans-serif;color:#1b1f23;max-width:980px;margin:40px auto;padding:0 24px}
h1{font-size:26px;font-weight:500}h2{font-size:19px;font-weight:500;margin:36px 0 8px}h3{font-size:16px;font-weight:500}
table{border-collapse:collapse;font-variant-numeric:tabular-nums;margin:10px 0}
th{font-weight:400;color:#5c6670;text-align:right;padding:3px 14px}
td{text-align:right;padding:4px 14px;border-top:1px solid #dfe3e7}
th:first-child,td:first-child{text-align:left;padding-left:0}img{max-width:100%;margin:12px 0}
pre{background:#f3f4f6;padding:12px 14px;border-radius:6px;overflow-x:auto;font-size:13px}.quiet{color:#5c6670}
"""
PAGE_IN = (8.27, 11.69)  # A4
WRAP = 96  # characters in a line of the PDF
LINES = 56  # on a page of it


@dataclass(frozen=True)
class Part:
    """One part of the report: a heading with sentences, a table, a picture, or lines as they are typed."""

    title: str = ""
    sentences: tuple[str, ...] = ()
    table: tuple[tuple[str, ...], ...] = ()  # the first row is its head
    picture: bytes = b""
    typed: tuple[str, ...] = ()


def parts(session: Session) -> Iterator[Part]:
    """Everything that was found, in the order in which it was."""
    opened, steps = session.opened, session.steps[: session.at + 1]
    if opened is None:
        return
    rows = [("recording", "length", "rate", "samples")]
    rows += [
        (one.source.rpartition("/")[2], f"{len(one) * one.dt_s:.0f} s", f"{1 / one.dt_s:.4g} Hz", str(len(one)))
        for one in opened.recordings
    ]
    yield Part("The recording", opened.notes, tuple(rows))
    yield from _ladder(steps)
    for step in steps:
        if step.compared is not None:
            yield from _compared(step.name, step.compared)
        if step.diagnosed is not None:
            yield from _diagnosed(step.name, step.diagnosed)
    yield Part("The same on the command line", typed=tuple(commands.lines(session)))
    columns = commands.column_settings(session)
    if columns:
        yield Part(commands.COLUMNS, typed=tuple(columns.splitlines()))


def as_html(session: Session) -> str:
    """One file without anything outside of it."""
    title = session.opened.source.title if session.opened else ""
    said = [f"<h1>{html.escape(title)}</h1>"]
    for part in parts(session):
        if part.title:
            said.append(f"<h2>{html.escape(part.title)}</h2>")
        said += [f"<p>{html.escape(one)}</p>" for one in part.sentences]
        if part.table:
            head, *rows = part.table
            cells = "".join(f"<th>{html.escape(one)}</th>" for one in head)
            body = "".join("<tr>" + "".join(f"<td>{html.escape(one)}</td>" for one in row) + "</tr>" for row in rows)
            said.append(f"<table><tr>{cells}</tr>{body}</table>")
        if part.picture:
            data = base64.b64encode(part.picture).decode()
            said.append(f'<img alt="{html.escape(part.title)}" src="data:image/png;base64,{data}">')
        if part.typed:
            said.append(f"<pre>{html.escape(chr(10).join(part.typed))}</pre>")
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>cruise: {html.escape(title)}</title>'
        f"<style>{STYLE}</style><body>{''.join(said)}</body></html>"
    )


def as_pdf(session: Session) -> bytes:
    """The same on A4 pages."""
    import textwrap

    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import image
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure

    out = io.BytesIO()
    with PdfPages(out) as pages:
        lines: list[tuple[str, str]] = [(session.opened.source.title if session.opened else "", "title"), ("", "")]

        def page() -> None:
            while lines:
                figure = Figure(figsize=PAGE_IN)
                for place, (text, kind) in enumerate(lines[:LINES]):
                    size = {"title": 17, "heading": 12.5}.get(kind, 8)
                    family = "monospace" if kind == "typed" else "sans-serif"
                    figure.text(0.08, 0.95 - 0.0158 * place, text, size=size, family=family, va="top", parse_math=False)
                pages.savefig(figure)
                del lines[:LINES]

        for part in parts(session):
            lines += [("", ""), (part.title, "heading"), ("", "")] if part.title else []
            for sentence in part.sentences:
                lines += [(one, "") for one in textwrap.wrap(sentence, WRAP + 16)]
            if part.table:
                widths = [max(len(row[k]) for row in part.table) for k in range(len(part.table[0]))]
                for row in part.table:
                    cells = [
                        f"{one:<{w}}" if k == 0 else f"{one:>{w}}"
                        for k, (one, w) in enumerate(zip(row, widths, strict=True))
                    ]
                    lines.append(("   ".join(cells), "typed"))
            for line in part.typed:
                lines += [(one, "typed") for one in textwrap.wrap(line, WRAP, subsequent_indent="    ") or [""]]
            if part.picture:
                page()
                pixels = image.imread(io.BytesIO(part.picture))
                figure = Figure(figsize=PAGE_IN)
                axis = figure.add_axes((0.05, 0.03, 0.9, 0.94))
                axis.imshow(pixels, interpolation="antialiased")
                axis.axis("off")
                pages.savefig(figure, dpi=170)
        page()
    return out.getvalue()


def _ladder(steps: list[Step]) -> Iterator[Part]:
    if len(steps) < 2:
        return
    rows = [("step", "error (m/s)", "before", "after", "noise floor")]
    for step in steps[1:]:
        added = step.added
        if added is not None:
            least, most = added.floor_mps
            floor = least if math.isfinite(least) else most
            errors = speed(added.error_before_mps), speed(added.error_after_mps)
            rows.append((step.name, "all data" if added.by_hand else "held out", *errors, speed(floor)))
    yield Part("How the error fell", table=tuple(rows))
    last = steps[-1].added
    if last is not None and last.parameters:
        numbers = [("parameter", "value", "standard error", "unit", "remark")]
        numbers += [
            (one.name, f"{one.after:.4g}", f"{one.std:.2g}" if math.isfinite(one.std) else "-", one.unit, one.remark)
            for one in last.parameters
        ]
        yield Part("Parameters", table=tuple(numbers))


def _compared(name: str, found: Compared) -> Iterator[Part]:
    rows = [("", "RMS error (m/s)", "mean error (m/s)", "NRMSE (%)", "explained (%)")]
    rows += [
        (
            one.name,
            number(one.rmse_mps),
            number(one.mean_error_mps),
            number(one.nrmse_pct, 1),
            number(one.explained_pct, 1),
        )
        for one in found.figures
    ]
    where = [one.sentence for one in found.regimes if one.named] + list(found.leaves)
    held_out = (f"The model was fitted before: {found.not_held_out}.",) if found.not_held_out else ()
    sentences = (f"The model was {found.how}.", *held_out, *found.floor_words, *where)
    yield Part(f"{name}: compared", sentences, tuple(rows), found.picture)


def _diagnosed(name: str, found: Diagnosed) -> Iterator[Part]:
    rows = [("effect", "error (m/s)", "explains (%)", "confidence")]
    rows += [
        (one.effect, speed(one.error_after_mps), f"{100 * one.gain:.0f}", one.confidence_words) for one in found.cards
    ]
    chosen = [f"{one.effect}: {one.physics} {one.equation}" for one in found.cards if one.chosen]
    sentences = (found.sentence, *chosen, *(f"Next: {one}" for one in found.next_experiment))
    yield Part(f"{name}: what is missing", sentences, tuple(rows), found.picture)
