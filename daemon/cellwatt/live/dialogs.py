"""Pages that open above the dashboard: a text to read, channels to choose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.screen import ModalScreen
from textual.widgets import Footer, Input, OptionList, Static


class Page(ModalScreen[None]):
    """A text to read; any of the named keys closes it."""

    CSS = """
    Page { align: center middle; }
    Page VerticalScroll { width: auto; max-width: 96%; height: auto; max-height: 90%; border: ascii $primary;
                          padding: 0 1; background: $background; }
    Page Static { width: auto; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,enter,q,space,question_mark", "dismiss", "close")]

    def __init__(self, text: Text) -> None:
        super().__init__()
        self._text = text

    def compose(self) -> ComposeResult:
        """Lay it out."""
        with VerticalScroll():
            yield Static(self._text)
        yield Footer(compact=True)


class Channels(ModalScreen[list[str]]):
    """Lets channels be chosen; none chosen means all. What is typed filters the list."""

    CSS = """
    Channels { align: center middle; }
    Channels Vertical { width: 60; max-width: 96%; height: 90%; border: ascii $primary; background: $background; }
    Channels Input { border: none; padding: 0 1; height: 1; background: $background; }
    Channels OptionList { height: 1fr; border: none; padding: 0; background: $background; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "move(-1)", show=False, priority=True),
        Binding("down", "move(1)", show=False, priority=True),
        Binding("enter", "mark", "choose", priority=True),
        Binding("escape", "take", "show what is chosen"),
        Binding("ctrl+a", "every", "show all", priority=True),
    ]

    def __init__(self, names: Sequence[str], chosen: Sequence[str]) -> None:
        super().__init__()
        self._names = names
        self._chosen = set(chosen)
        self._listed: list[str] = []

    def compose(self) -> ComposeResult:
        """Lay it out."""
        with Vertical():
            yield Input(placeholder="part of a name", compact=True)
            yield OptionList(markup=False)
        yield Footer(compact=True)

    def on_mount(self) -> None:
        """List all channels; what is typed goes to the filter."""
        self.query_one(OptionList).can_focus = False
        self.query_one(Input).focus()
        self._list("")

    def on_input_changed(self, event: Input.Changed) -> None:
        """List the channels that have the text in their name."""
        self._list(event.value)

    def action_move(self, step: int) -> None:
        """Go to the next channel, or the one before."""
        options = self.query_one(OptionList)
        options.action_cursor_down() if step > 0 else options.action_cursor_up()

    def action_mark(self) -> None:
        """Choose the channel, or no longer."""
        options = self.query_one(OptionList)
        if self._listed and options.highlighted is not None:
            name = self._listed[options.highlighted]
            self._chosen ^= {name}
            options.replace_option_prompt_at_index(options.highlighted, self._prompt(name))

    def action_take(self) -> None:
        """Close with what was chosen."""
        self.dismiss([name for name in self._names if name in self._chosen])

    def action_every(self) -> None:
        """Close with all channels."""
        self.dismiss([])

    def _list(self, part: str) -> None:
        self._listed = [name for name in self._names if part in name]
        options = self.query_one(OptionList)
        options.clear_options().add_options([self._prompt(name) for name in self._listed])
        options.highlighted = 0 if self._listed else None

    def _prompt(self, name: str) -> str:
        return f"[{'x' if name in self._chosen else ' '}] {name}"
