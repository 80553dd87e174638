"""Colours, type and the look of the charts, light and dark.

The colours of curves are those of M. Okabe and K. Ito, "Color Universal Design", 2008, which colour-blind people tell
apart; what is measured is ink, what is predicted blue, what is compared with it orange.
"""

from dataclasses import dataclass
from typing import Any, Final


@dataclass(frozen=True)
class Theme:
    """One set of colours."""

    page: str
    surface: str
    ink: str
    muted: str
    line: str
    accent: str
    measured: str
    model: str
    other: str
    free: str
    error: str
    good: str
    mark: str


LIGHT: Final = Theme(
    page="#f6f7f8",
    surface="#ffffff",
    ink="#1b1f23",
    muted="#5c6670",
    line="#dfe3e7",
    accent="#0072B2",
    measured="#31373d",
    model="#0072B2",
    other="#E69F00",
    free="#009E73",
    error="#D55E00",
    good="#009E73",
    mark="#E69F00",
)
DARK: Final = Theme(
    page="#101316",
    surface="#171b1f",
    ink="#e4e7ea",
    muted="#98a2ac",
    line="#2b3238",
    accent="#56B4E9",
    measured="#c9d0d6",
    model="#56B4E9",
    other="#E69F00",
    free="#2fc79a",
    error="#f0803c",
    good="#2fc79a",
    mark="#E69F00",
)
# Not responsive: an observer of each chart would outlive it where it goes at once; RESIZE follows the window instead.
COMMON_CONFIG: Final = {"displayModeBar": False, "showTips": False, "responsive": False}
CHART_CONFIG: Final = {**COMMON_CONFIG, "scrollZoom": True, "doubleClick": "reset"}
STILL_CONFIG: Final = {**COMMON_CONFIG, "scrollZoom": False, "doubleClick": False}
RESIZE: Final = """
addEventListener("resize", async () => {
  const { Plotly } = await import("nicegui-plotly")
  for (const plot of document.querySelectorAll(".js-plotly-plot"))
    if (plot.checkVisibility()) Plotly.Plots.resize(plot)
})
"""
FONT: Final = "Roboto, system-ui, sans-serif"


def of(dark: bool) -> Theme:
    """The colours by day or by night."""
    return DARK if dark else LIGHT


def faint(color: str, share: float) -> str:
    """A colour of which `share` covers what lies below."""
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{share})"


def axis(theme: Theme, **own: Any) -> dict[str, Any]:
    """An axis of a chart."""
    return {
        "gridcolor": theme.line,
        "zerolinecolor": theme.line,
        "linecolor": theme.line,
        "tickfont": {"size": 11, "color": theme.muted},
        "title": {"font": {"size": 12, "color": theme.muted}, "standoff": 8},
        "automargin": False,
        # What the script would find out anew with every zoom: half of its time.
        "type": "linear",
        "ticklabeloverflow": "allow",
        **own,
    }


def layout(theme: Theme, height: int, **own: Any) -> dict[str, Any]:
    """What all charts share."""
    return {
        "height": height,
        "margin": {"l": 60, "r": 14, "t": 14, "b": 44},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": FONT, "size": 12, "color": theme.ink},
        "showlegend": False,
        "hoverlabel": {
            "bgcolor": theme.surface,
            "bordercolor": theme.line,
            "font": {"size": 12, "color": theme.ink, "family": FONT},
        },
        "autosize": True,
        **own,
    }


def style_sheet() -> str:
    """The page's CSS: variables for both themes, and what Quasar's components are missing."""
    names = ("page", "surface", "ink", "muted", "line", "accent", "good", "error", "other")
    light, dark = (";".join(f"--{name}:{getattr(one, name)}" for name in names) for one in (LIGHT, DARK))
    return f":root{{{light}}}\nbody.body--dark{{{dark}}}\n{RULES}"


RULES: Final = """
html { overflow-y: scroll; }
body { --q-primary: var(--accent) !important; }
body { background: var(--page) !important; color: var(--ink); font-size: 14px; line-height: 1.5;
  font-family: Roboto, system-ui, sans-serif; -webkit-font-smoothing: antialiased; }
.nicegui-content { padding: 0 !important; align-items: stretch; }
.nicegui-sub-pages { width: 100%; align-items: stretch; }
p { margin: 0; }
.w-full { width: 100%; } .items-center { align-items: center; } .items-end { align-items: flex-end; }
.items-start { align-items: flex-start; } .gap-0 { gap: 0; } .gap-1 { gap: 4px; } .gap-2 { gap: 8px; }
.gap-3 { gap: 12px; } .gap-4 { gap: 16px; } .gap-6 { gap: 24px; } .gap-8 { gap: 32px; } .gap-10 { gap: 40px; }
.gap-12 { gap: 48px; }
.title { font-size: 22px; font-weight: 500; line-height: 1.3; letter-spacing: -.005em; }
.subtitle { font-size: 15px; font-weight: 500; line-height: 1.4; letter-spacing: 0; }
.lead { color: var(--muted); max-width: 74ch; }
.quiet { color: var(--muted); } .small { font-size: 12.5px; } .strong { font-weight: 500; }
.num { font-variant-numeric: tabular-nums; } .good { color: var(--good); } .bad { color: var(--error); }
.mono { font-family: ui-monospace, "DejaVu Sans Mono", Menlo, Consolas, monospace; font-size: 12.5px; }
.measure { max-width: 74ch; }
.frame { display: flex; width: 100%; align-items: flex-start; }
.rail { width: 212px; flex: none; height: 100vh; position: sticky; top: 0; border-right: 1px solid var(--line);
  background: var(--surface); padding: 20px 12px 16px; display: flex; flex-direction: column; gap: 2px; }
.brand { font-size: 15px; font-weight: 500; padding: 0 10px 16px; }
.step { display: flex; gap: 10px; align-items: baseline; padding: 7px 10px; border-radius: 6px; color: var(--ink)
  !important;
  text-decoration: none !important; border-left: 0; }
.step .nr { color: var(--muted); width: 14px; font-variant-numeric: tabular-nums; font-size: 12.5px; }
.step > span { min-width: 0; overflow-wrap: anywhere; }
.step .sub { color: var(--muted); font-size: 12px; line-height: 1.35; display: block; }
.card .subtitle { overflow-wrap: anywhere; }
.step:hover { opacity: 1; background: color-mix(in srgb, var(--ink) 5%, transparent); }
.step.here { background: color-mix(in srgb, var(--accent) 12%, transparent); }
.step.here .nr, .step.here .name { color: var(--accent); font-weight: 500; }
.main { flex: 1; min-width: 0; padding: 26px 32px 96px; display: flex; flex-direction: column; gap: 20px;
  max-width: 1420px; }
.card { background: var(--surface); border: 1px solid var(--line); border-radius: 8px; padding: 16px 18px; width:
  100%;
  display: flex; flex-direction: column; gap: 10px; min-width: 0; }
.card.pick { cursor: pointer; text-align: left; } .card.pick:hover { border-color: var(--accent); }
.grid2 { display: grid; grid-template-columns: 1fr 1fr; gap: 16px; width: 100%; align-items: stretch; }
.grid3 { display: grid; grid-template-columns: repeat(3, 1fr); gap: 16px; width: 100%; align-items: stretch; }
.wide-left { grid-template-columns: minmax(0, 1.35fr) minmax(0, 1fr); }
.grid2 > *, .grid3 > * { min-width: 0; }
.tried { display: grid; grid-template-columns: minmax(110px, 170px) 90px minmax(80px, 1fr) 100px 18px; gap: 4px 16px;
  align-items: center; }
@media (max-width: 1150px) { .rail { width: 176px; } .main { padding: 20px 20px 96px; }
  .wide-left, .grid3 { grid-template-columns: 1fr; } }
table.figures { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
table.figures th { font-weight: 400; color: var(--muted); font-size: 12.5px; text-align: right; padding: 4px 12px
  6px; }
table.figures td { text-align: right; padding: 6px 12px; border-top: 1px solid var(--line); white-space: nowrap; }
table.figures th:first-child, table.figures td:first-child { text-align: left; padding-left: 0; white-space: normal; }
table.figures td.words, table.figures th.words { text-align: left; }
table.figures td:last-child, table.figures th:last-child { padding-right: 0; }
.hint { border-bottom: 1px dotted var(--muted); cursor: help; }
.legend { display: flex; gap: 18px; flex-wrap: wrap; font-size: 12.5px; color: var(--muted); align-items: center; }
.key { display: inline-block; width: 18px; height: 0; border-top: 2px solid; margin-right: 7px; vertical-align:
  middle; }
.key.patch { height: 10px; border: 0; border-radius: 2px; }
.bar { height: 6px; border-radius: 3px; background: var(--line); position: relative; overflow: hidden; width: 100%; }
.bar > div { position: absolute; inset: 0 auto 0 0; border-radius: 3px; }
.verdict { border-left: 3px solid var(--accent); padding: 4px 0 4px 16px; font-size: 17px; line-height: 1.5;
  max-width: 80ch; }
.verdict.calm { border-color: var(--good); } .verdict.open { border-color: var(--other); }
.formula { background: color-mix(in srgb, var(--ink) 4%, transparent); border-radius: 6px; padding: 9px 12px;
  white-space: pre-wrap; overflow-wrap: anywhere; }
.figure { font-size: 24px; font-weight: 400; line-height: 1.2; font-variant-numeric: tabular-nums; white-space:
  nowrap; }
.figure small { font-size: 13px; color: var(--muted); margin-left: 4px; }
.dock { position: fixed; bottom: 20px; left: 50%; transform: translateX(-50%); z-index: 50; background:
  var(--surface);
  border: 1px solid var(--line); border-radius: 10px; box-shadow: 0 6px 28px rgba(0,0,0,.16);
  padding: 10px 14px 10px 18px;
  display: flex; gap: 14px; align-items: center; width: max-content; min-width: min(420px, 100vw - 24px);
  max-width: min(680px, 100vw - 24px); }
.busy { width: 10px; height: 10px; border-radius: 50%; flex: none; background: var(--accent);
  animation: busy 1.2s steps(1) infinite; }
@keyframes busy { 50% { opacity: .25; } }
.chip { border: 1px solid var(--line); border-radius: 12px; padding: 1px 10px; font-size: 12px; color: var(--muted); }
.chip.now { border-color: var(--accent); color: var(--accent); }
.row-button { width: 100%; text-align: left; border: 0; background: none; padding: 8px 10px; border-radius: 6px;
  color: inherit;
  font: inherit; cursor: pointer; display: block; }
.row-button:hover { background: color-mix(in srgb, var(--ink) 5%, transparent); }
.row-button.here { background: color-mix(in srgb, var(--accent) 12%, transparent); }
:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px; }
/* Quasar's own important rules give way only to those of an earlier layer. */
@layer overrides {
  .q-btn:focus-visible, .q-toggle:focus-visible { outline: 2px solid var(--accent) !important; }
  body.body--dark .q-btn.bg-primary { color: var(--page) !important; }
}
.q-btn { text-transform: none; font-weight: 500; letter-spacing: 0; }
.q-btn .q-icon { font-size: 18px; } .q-btn .on-left { margin-right: 8px; }
.q-btn .q-focus-helper { display: none; }
.q-btn.bg-primary { background: var(--accent) !important; }
.q-field { max-width: 100%; }
.q-field--outlined .q-field__control { border-radius: 6px; } .q-field__native, .q-field__input { font-size: 14px; }
.q-tooltip { font-size: 12.5px; line-height: 1.45; max-width: 340px; background: #22272c; padding: 8px 11px; }
.q-uploader { width: 100%; box-shadow: none; border: 1.5px dashed var(--line); border-radius: 8px; background:
  transparent !important; }
.q-uploader__header { background: transparent !important; color: var(--ink) !important; }
.q-uploader__subtitle { display: none; }
.q-uploader__list { min-height: 96px; padding: 8px; }
.js-plotly-plot .plotly .cursor-crosshair { cursor: crosshair; }
a { color: var(--accent); }
@media (max-width: 900px) {
  table.figures th, table.figures td { padding-left: 6px; padding-right: 6px; }
  table.figures td.words { white-space: normal; }
  .evidence { grid-template-columns: minmax(0, 1fr); } table.figures { display: block; overflow-x: auto; }
}
@media (max-width: 700px) {
  .frame { flex-direction: column; align-items: stretch; }
  .rail { position: static; width: 100%; height: auto; flex-direction: row; align-items: center; overflow-x: auto;
    padding: 6px 12px; border-right: 0; border-bottom: 1px solid var(--line); }
  .rail > * { flex: none; } .brand, .step .sub { display: none; } .step { white-space: nowrap; }
  .main { padding: 16px 12px 96px; } .card { padding: 14px; } .gap-12, .gap-10 { gap: 20px; }
  .grid2, .grid3 { grid-template-columns: minmax(0, 1fr); }
  .tried { grid-template-columns: minmax(0, 1fr) 90px 18px; } .tried .share { display: none; }
  .tried .mark { grid-area: 1 / 3; }
}
"""
