"""Progress of long work: a bar on a terminal, lines elsewhere; shown only if a command or program enables it."""

from cellwatt.progress.work import Stage, Work, WorkState, aside, listening, show_progress, stage, steps

__all__ = ["Stage", "Work", "WorkState", "aside", "listening", "show_progress", "stage", "steps"]
