"""From a fit to what is said: parameters, findings, and what stays unexplained."""
