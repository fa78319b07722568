"""Progress of long work: a bar on a terminal, lines elsewhere, nothing unless a command or a program asks for it."""

from cellwatt.progress.work import Stage, Work, WorkState, aside, listening, show_progress, stage, steps

__all__ = ["Stage", "Work", "WorkState", "aside", "listening", "show_progress", "stage", "steps"]
