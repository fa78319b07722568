"""Shows a live cell in the Foxglove app.

serve       streams a cell to the app; topics, schemas and encodings are those of our recordings
layout_for  the panels for a cell, live and recorded; layout_of takes its settings file
"""

from cellwatt.outlets.foxglove.layout import layout_for, layout_of
from cellwatt.outlets.foxglove.serving import serve

__all__ = ["layout_for", "layout_of", "serve"]
