"""Units that the settings in a recording choose."""

from __future__ import annotations

from collections.abc import Iterable

from pydantic import ValidationError

from cellwatt.errors import RecordingError
from cellwatt.units import Units
from cellwatt.yaml_file import NotYamlError, parse_yaml


def recorded_units(settings: str, names: Iterable[str]) -> Units:
    """Units of a recording's ``settings``, the text in its header, with those of the command line in their place.

    Raises ``RecordingError`` where they cannot be read.
    """
    try:
        written = parse_yaml(settings)
        chosen = written.get("units") if isinstance(written, dict) else None
        return Units.model_validate(chosen or {}).but(names)
    except NotYamlError as error:
        raise RecordingError(f"the settings in the recording cannot be read: {str(error).splitlines()[0]}") from error
    except ValidationError:
        raise RecordingError("the units in the recording's settings cannot be read: expected names of units") from None
