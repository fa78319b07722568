"""The dashboard of ``cellwatt watch``.

A thread takes the messages, so a terminal that is slow to draw holds up nobody: the state is drawn four times a second,
or less often.
"""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar, Final

from rich.text import Text
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.widgets import ContentSwitcher, Footer, OptionList, Static
from textual.widgets.option_list import Option
from textual.worker import get_current_worker

from cellwatt.live import view
from cellwatt.live.dialogs import Channels, Page
from cellwatt.live.lines import fit, plain
from cellwatt.live.power import power
from cellwatt.live.state import Body, LiveCell
from cellwatt.live.view import Look
from cellwatt.subscriber import Message

REDRAW: Final = 0.25
"""s between two drawings."""
PAGES: Final = ("overview", "channels", "alarms", "energy")
SPANS: Final = (10.0, 60.0)
"""s of a course."""
HELP: Final = """\
1 2 3 4  overview, channels, alarms, energy      tab  the next page
c        choose channels: text filters them, enter chooses one
enter    on an alarm: evidence and alternatives
s        courses over 10 s or 60 s
u        clock in UTC or local time
space    stop and go on; alarms are counted all the while
↑ ↓      scroll, or walk through the alarms
q        quit

state    green: all is well; amber: something is not; red: no source delivers, or nothing can be recorded
clock ±  how far a time stamp may be wrong at most
expected = received + lost, for each source, at every moment
"""


class LiveApp(App[None]):
    """Shows a cell while ``messages`` come, each second at least ``None``; it ends with them."""

    TITLE = "cellwatt watch"
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    #head, #pages { height: auto; }
    VerticalScroll, ContentSwitcher, OptionList { height: 1fr; background: $background; border: none; padding: 0; }
    #pages { margin-bottom: 1; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        *(Binding(str(n), f"page('{page}')", show=False) for n, page in enumerate(PAGES, 1)),
        Binding("tab", "turn(1)", "page", priority=True),
        Binding("shift+tab", "turn(-1)", show=False, priority=True),
        Binding("c", "choose", "channels"),
        Binding("s", "span", "10/60 s"),
        Binding("u", "zone", "UTC/local"),
        Binding("space", "pause", "pause"),
        Binding("question_mark", "help", "help", key_display="?"),
        Binding("q", "quit", "quit"),
    ]

    def __init__(self, messages: Iterable[Message | None], look: Look, cell: LiveCell | None = None) -> None:
        super().__init__()
        # The terminal's own colours, light or dark; those have no shades of grey that stand for them without colours.
        self.theme = "textual-dark" if self.no_color else "ansi-dark"
        self.look = look
        self.page: str = PAGES[0]
        self.problem: Exception | None = None
        self.paused = False
        self._messages = messages
        self._cell = cell or LiveCell()
        self._lock = threading.Lock()
        self._listed: tuple[object, ...] = ()

    def compose(self) -> ComposeResult:
        """Lay out the pages."""
        yield Static(id="head")
        yield Static(id="pages")
        with ContentSwitcher(initial=PAGES[0]):
            for page in PAGES:
                if page == "alarms":
                    yield OptionList(id=page, markup=False)
                else:
                    with VerticalScroll(id=page):
                        yield Static(id=f"{page}-text")
        yield Footer(compact=True)

    def on_mount(self) -> None:
        """Begin to take messages and to draw."""
        if not self.is_headless:
            for number in (signal.SIGTERM, signal.SIGHUP):
                asyncio.get_running_loop().add_signal_handler(number, self.exit)
        self.run_worker(self._take, thread=True)
        self.set_interval(REDRAW, self.draw)
        self.action_page(self.page)

    def _take(self) -> None:
        worker = get_current_worker()
        try:
            for message in self._messages:
                if worker.is_cancelled:
                    return
                if message is not None:
                    with self._lock:
                        self._cell.take(message)
        except Exception as error:
            self.problem = error
        if self.is_running:
            self.call_from_thread(self.exit)

    # drawing ----------------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw the state as it is now."""
        if not self.query("#head"):
            return  # the app is ending
        self.look = replace(self.look, width=max(20, self.size.width - 2))
        with self._lock:
            self.query_one("#head", Static).update(self._head())
            self.query_one("#pages", Static).update(self._titles())
            if self.paused:
                return
            if self.page == "alarms":
                self._list_alarms()
            elif self._cell.status:
                self.query_one(f"#{self.page}-text", Static).update(self.look.page(self._lines()))

    def _head(self) -> Text:
        lines = view.head(self._cell, self.look)
        if self.paused:
            lines[0] = fit(Text("paused  ", "reverse").append_text(lines[0]), self.look.width)
        return self.look.page(lines)

    def _titles(self) -> Text:
        line = Text()
        for n, page in enumerate(PAGES, 1):
            active = page == "alarms" and self._cell.alarms
            label = f" {n} {page}{f' ({len(self._cell.alarms)})' if active else ''} "
            line.append(label, f"{'reverse ' * (page == self.page)}{'bold red' if active else 'bold'}").append(" ")
        return line

    def _lines(self) -> list[Text]:
        cell, look = self._cell, self.look
        if self.page == "channels":
            return view.channels(cell, look)
        if self.page == "energy":
            return view.energies(cell, look)
        lines = [*view.alarms(cell, look), Text(), *view.sources(cell, look), Text()]
        lines += [*view.motion(cell, look), *view.energy(cell), *power(cell, look.span, look.width, look.power)]
        room = self.query_one("#overview").size.height - len(lines) - 1
        if room > 1 and cell.frames.names:
            lines += [Text(), *view.channels(cell, look)[:room]]
        return [fit(line, look.width) for line in lines]

    def alarms(self) -> list[Body]:
        """Active alarms, then those of this session that were cleared, the latest first."""
        return [*view.ranked(self._cell), *reversed(self._cell.cleared)]

    def _list_alarms(self) -> None:
        shown = self.alarms()
        listed = (self.look, *((a["id"], a["active"], a["time"]) for a in shown))
        if listed == self._listed:
            return
        self._listed = listed
        options = self.query_one("#alarms", OptionList)
        at = options.highlighted
        named = [Option(self._alarm(alarm)) for alarm in shown] or [Option("no alarm in this session")]
        options.clear_options().add_options(named)
        options.highlighted = min(at or 0, options.option_count - 1)

    def _alarm(self, alarm: Body) -> Text:
        line = Text(f"{self.look.clock(alarm['since'])}  ")
        line.append(f"{alarm['severity'] if alarm['active'] else 'cleared':<8}", view.SEVERITY[alarm["severity"]])
        joint = "" if alarm["joint"] is None else f"joint {alarm['joint']}"
        line.append(f"{joint:<8} {alarm['statement']}")
        line.stylize("" if alarm["active"] else "dim")
        return plain(line) if self.look.ascii else line

    # keys -------------------------------------------------------------------------------------------

    def action_page(self, page: str) -> None:
        """Show a page."""
        self.page = page
        self.query_one(ContentSwitcher).current = page
        self.query_one(f"#{page}").focus()
        self.draw()

    def action_turn(self, step: int) -> None:
        """Show the next page, or the one before."""
        if len(self.screen_stack) == 1:
            self.action_page(PAGES[(PAGES.index(self.page) + step) % len(PAGES)])

    def action_span(self) -> None:
        """Show courses over the other span."""
        self._see(span=SPANS[(SPANS.index(self.look.span) + 1) % len(SPANS)])

    def action_zone(self) -> None:
        """Show times in UTC, or in local time."""
        self._see(utc=not self.look.utc)

    def action_pause(self) -> None:
        """Stop to draw the pages, or go on."""
        self.paused = not self.paused
        self.draw()

    def action_help(self) -> None:
        """Explain keys and words."""
        self.push_screen(Page(self.look.page([Text(line) for line in HELP.splitlines()])))

    def action_choose(self) -> None:
        """Let channels be chosen."""
        with self._lock:
            names = self._cell.frames.names
        if names:
            chosen = [name for name in names if self.look.takes(name)] if self.look.channels else []
            self.push_screen(Channels(names, chosen), self._chosen)

    def _chosen(self, channels: list[str] | None) -> None:
        self._see(channels=tuple(channels or ()))

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Show all that an alarm says."""
        with self._lock:
            shown = self.alarms()
            if event.option_index < len(shown):
                look = replace(self.look, width=min(100, self.look.width - 6))
                self.push_screen(Page(look.page(view.details(shown[event.option_index], look))))

    def _see(self, **changed: object) -> None:
        self.look = replace(self.look, **changed)  # type: ignore[arg-type]
        self.draw()
