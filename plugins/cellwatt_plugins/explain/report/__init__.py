"""``report.html``: the findings of ``explain`` on one self-contained page."""
