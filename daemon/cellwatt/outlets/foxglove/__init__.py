"""Shows a live cell in the Foxglove app.

serve       streams a cell to the app, with the topics, schemas and encodings of the recordings
layout_for  the panels for a cell, live or recorded; layout_of makes them from its settings file
"""

from cellwatt.outlets.foxglove.layout import layout_for, layout_of
from cellwatt.outlets.foxglove.serving import serve

__all__ = ["layout_for", "layout_of", "serve"]
