"""A file beside a recording with what the Foxglove app draws and recordings do not hold."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from cellwatt.batch import Batch, Tick
from cellwatt.errors import OutletError
from cellwatt.files import Places
from cellwatt.frames import Frames
from cellwatt.outlets.foxglove.outlet import Channels, library
from cellwatt.outlets.foxglove.serving import skeletons_of
from cellwatt.outlets.foxglove.topics import CHANNELS, LOG, SCENE, TRANSFORMS, Moment
from cellwatt.outlets.foxglove.translate import Translator
from cellwatt.record import Recording

ADDED: Final = (LOG, TRANSFORMS, SCENE, CHANNELS)
"""Topics that a live cell has and a recording has not."""


def companion(recording: Places, out: Path, arms: Mapping[str, Path] | None = None) -> dict[str, int]:
    """Write log, transforms and links of a recording to ``out`` (.mcap), and return the messages by topic.

    The app opens both files together. ``arms`` as for ``serve``. Raises ``ConfigError`` and ``RecordingError``, and
    ``OutletError`` if ``out`` is there already or cannot be written.
    """
    fox = library()
    translator = Translator(skeletons_of(arms or {}))
    read = Recording.open(recording)
    context = fox.Context()
    channels = Channels(context, (topic for topic in translator.topics if topic.name in ADDED))
    try:
        with fox.open_mcap(out, context=context):
            for moment in _moments(read, translator):
                for outgoing in moment.messages:
                    if outgoing.topic.name in ADDED:
                        channels.log(outgoing)
    except OSError as error:
        raise OutletError(f"{out} cannot be written: {error.strerror or error}") from None
    finally:
        channels.close()
    return dict(channels.sent)


def _moments(recording: Recording, translator: Translator) -> Iterator[Moment]:
    for _, item in recording.items():  # noqa: PERF102 - a recording is no dict
        match item:
            case Frames():
                yield from translator.frames(item)
            case Batch() | Tick():
                continue
            case _:
                yield translator.item(item)
