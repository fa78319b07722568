"""``report.html``: what ``explain`` found, on one page that needs nothing else."""
