"""``python -m cellwatt.outlets.foxglove OUT`` writes the packaged layout of a cell like the demo's."""

import sys
from pathlib import Path

from cellwatt.outlets.foxglove.layout import LIKE_THE_DEMO, layout_for, text_of

Path(sys.argv[1]).write_text(text_of(layout_for(LIKE_THE_DEMO, ["power"])), encoding="utf-8")
