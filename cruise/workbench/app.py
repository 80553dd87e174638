"""The page itself: the rail of steps, the view beside it, and what is being computed at the bottom."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from nicegui import app, ui

from cruise.workbench import jobs, theme, verbs
from cruise.workbench.guard import Guard
from cruise.workbench.live import Live
from cruise.workbench.page import Page
from cruise.workbench.parts import busy, speed
from cruise.workbench.session import SEARCH, Session
from cruise.workbench.setup import Setup
from cruise.workbench.views import adding, comparing, failing, living, missing, opening, taking

POLL_S: Final = 0.1
FORM_BYTES: Final = 2**20  # of what surrounds the files of an upload
SESSIONS: Final = 24  # the oldest idle one is let go


@dataclass(frozen=True)
class View:
    """One step of the walk."""

    path: str
    name: str
    show: Callable[[Page], None]


VIEWS: Final = (
    View("/", "Open", opening.show),
    View("/compare", "Compare", comparing.show),
    View("/fails", "Where it fails", failing.show),
    View("/missing", "What is missing", missing.show),
    View("/add", "Add", adding.show),
    View("/take", "Take away", taking.show),
    View("/live", "Live", living.show),
)


class Workbench:
    """The server's side: one session a tab."""

    def __init__(self, setup: Setup, begin: Callable[[Session], None] = lambda session: None) -> None:
        self.setup, self.begin = setup, begin
        self.sessions: dict[str, Session] = {}
        self.live = Live()

    def session(self, tab: str) -> Session:
        """The session of a tab, begun with its first visit."""
        known = self.sessions.pop(tab, None)
        if known is None:
            known = Session(self.setup)
            self.begin(known)
            idle = [name for name, one in self.sessions.items() if not one.busy and not one.pages]
            if len(self.sessions) >= SESSIONS and idle:
                self.sessions.pop(idle[0]).close()
        self.sessions[tab] = known
        return known

    def poll(self) -> None:
        """Take in what the jobs of all sessions say, of those too whose tab was closed."""
        for session in list(self.sessions.values()):
            session.poll()

    def close(self) -> None:
        """Stop everything that is under way, and leave no file behind."""
        self.live.stop()
        for session in self.sessions.values():
            session.close()

    async def root(self) -> None:
        """Build the page for one browser tab."""
        ui.add_css(theme.style_sheet())
        await ui.context.client.connected()
        tab = ui.context.client.tab_id
        if tab is None:  # whoever asked runs no script
            return
        session = self.session(tab)
        session.pages += 1
        ui.context.client.on_delete(session.left)
        ui.run_javascript(theme.RESIZE)
        page = Page(session, self.setup, self.live, ui.context.client)
        if session.dark is None:
            session.dark = bool(
                await ui.run_javascript("matchMedia('(prefers-color-scheme: dark)').matches", timeout=5)
            )
        dark = ui.dark_mode(value=session.dark)
        with ui.element("div").classes("frame"):
            rail = ui.element("nav").classes("rail").props('aria-label="steps"')
            with ui.element("div").classes("main"):  # in the main of the page's frame
                faults = ui.column().classes("w-full gap-0")
                views = ui.sub_pages({view.path: (lambda view=view: view.show(page)) for view in VIEWS})
        ui.plotly({"data": [], "layout": {}, "config": {"responsive": False, "displayModeBar": False}}).style(
            "display:none"
        )  # the browser loads its part before it is needed
        dock = ui.element("div").classes("dock").props("role=status")

        def turn() -> None:
            session.dark = not session.dark
            dark.set_value(session.dark)
            refresh()

        seen = session.version

        def refresh() -> None:
            nonlocal seen
            seen = session.version
            with page.client:  # whoever asks for it may be gone by then
                views.refresh()
                around()

        def around() -> None:
            rail.clear()
            with rail:
                _rail(page, turn)
            faults.clear()
            if session.fault:
                with faults:
                    _fault(page)
            _dock(page, dock)

        page.refresh = refresh
        ui.context.client.sub_pages_router.on_path_changed(lambda _: around())
        around()

        def poll() -> None:
            nonlocal seen
            if session.version != seen or session.fresh:
                seen = session.version
                if session.fresh and page.path == "/":
                    page.go("/compare")
                else:
                    refresh()
                session.fresh = False

        ui.timer(POLL_S, poll)


def _rail(page: Page, turn: Callable[[], None]) -> None:
    session = page.session
    here = page.path
    ui.label("cruise workbench").classes("brand")
    for place, view in enumerate(VIEWS, 1):
        with ui.link(target=view.path).classes("step here" if here == view.path else "step") as link:
            if here == view.path:
                link.props('aria-current="page"')
            ui.label(str(place)).classes("nr")
            with ui.element("span"):
                ui.label(view.name).classes("name").style("display:block")
                said = _state(session, view.path)
                if said:
                    ui.label(said).classes("sub num")
    ui.element("div").style("flex:1")
    icon, words = ("light_mode", "light") if session.dark else ("dark_mode", "dark")
    ui.button(words, icon=icon, on_click=turn).props("flat no-caps dense size=sm").style(
        "align-self:flex-start"
    ).classes("quiet")


def _state(session: Session, path: str) -> str:
    """What stands behind a step, in a few words."""
    step = session.step
    if path == "/":
        return session.opened.source.title if session.opened else ""
    if step is None:
        return ""
    if path == "/compare" and step.compared:
        return f"{speed(step.compared.error_mps)} m/s"
    if path == "/missing" and step.diagnosed:
        return ", ".join(step.diagnosed.effects or step.diagnosed.signals) or step.diagnosed.verdict
    if path == "/missing":
        return ", ".join(session.found_before)
    if path == "/add" and len(session.steps) > 1:
        return f"step {session.at} of {len(session.steps) - 1}"
    return ""


def _fault(page: Page) -> None:
    session = page.session
    with (
        ui.element("div").classes("card").props("role=alert").style("border-color:var(--error)"),
        ui.row().classes("items-start no-wrap w-full gap-4"),
    ):
        ui.label(session.fault).style("white-space:pre-wrap; flex:1; overflow-wrap:anywhere").classes(
            "mono" if session.fault.startswith("Traceback") else ""
        )

        def close() -> None:
            session.fault = ""
            page.refresh()

        ui.button(icon="close", on_click=close).props('flat round dense size=sm aria-label="close"')


def _dock(page: Page, dock: ui.element) -> None:
    session = page.session
    dock.clear()
    job = session.job
    shown = job is not None and job.running and not (page.path == "/missing" and job.title == SEARCH)
    dock.set_visibility(shown)
    if job is None or not shown:
        return
    with dock:
        busy()
        with ui.column().classes("gap-0").style("flex:1; min-width:0"):
            ui.label(job.title).classes("strong")
            ui.label().classes("quiet small").bind_text_from(
                session, "job", lambda job: job.told[-1] if job and job.told else "starting"
            )
        ui.button("Stop", on_click=page.do(session.cancel)).props("flat no-caps dense")


def serve(workbench: Workbench, host: str, port: int, token: str, show: bool) -> None:
    """Serve the page until it is stopped."""
    jobs.prepare([verbs.__name__])
    guarded(token, port, workbench.setup.upload_bytes)
    app.on_shutdown(workbench.close)
    app.timer(POLL_S, workbench.poll)
    ui.run(
        workbench.root,
        host=host,
        port=port,
        title="cruise workbench",
        favicon=FAVICON,
        show=show,
        reload=False,
        show_welcome_message=False,
        reconnect_timeout=30.0,
        dark=None,
        language="en-US",
        tailwind=False,  # its script watches every change of the page, and costs a tenth of each zoom
    )


def guarded(token: str, port: int, upload_bytes: int) -> None:
    """Nobody else gets in, and nothing longer."""
    app.add_middleware(Guard, token=token, port=port, most_bytes=upload_bytes + FORM_BYTES)


FAVICON: Final = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><path d="M4 24 L12 12 L19 18 L28 6" fill="none" '
    'stroke="#0072B2" stroke-width="4" stroke-linecap="round" stroke-linejoin="round"/></svg>'
)
