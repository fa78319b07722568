"""From a fit to the report: parameters, findings, and what stays unexplained."""
