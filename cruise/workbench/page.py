"""What every view is given: the session of its tab, the colours, and how to say that something has changed."""

from collections.abc import Callable
from dataclasses import dataclass

from nicegui import Client, ui

from cruise.workbench import theme
from cruise.workbench.live import Live
from cruise.workbench.session import Session
from cruise.workbench.setup import Setup
from cruise.workbench.theme import Theme


@dataclass(eq=False)
class Page:
    """One open page."""

    session: Session
    setup: Setup
    live: Live
    client: Client
    refresh: Callable[[], None] = lambda: None

    @property
    def colors(self) -> Theme:
        """The colours by day or by night."""
        return theme.of(bool(self.session.dark))

    @property
    def path(self) -> str:
        """Which view is shown."""
        return self.client.sub_pages_router.current_path

    def do(self, action: Callable[[], None]) -> Callable[[], None]:
        """The action, after which the page is shown anew."""

        def act() -> None:
            action()
            self.refresh()

        return act

    def go(self, path: str) -> None:
        """To another view."""
        ui.navigate.to(path)
