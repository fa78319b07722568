"""Shows a live cell, and what its recordings lack, in the Foxglove app.

serve       streams a cell to the app; topics, schemas and encodings are those of our recordings
companion   writes a file beside a recording with the arm in space and the log, for the app to open together
layout_for  the panels for a cell, live and recorded; layout_of takes its settings file
"""

from cellwatt.outlets.foxglove.layout import layout_for, layout_of
from cellwatt.outlets.foxglove.serving import companion, serve

__all__ = ["companion", "layout_for", "layout_of", "serve"]
