"""Bill of materials in CycloneDX 1.6: ``python -m cellwatt.sbom > cellwatt.cdx.json``.

Lists the packages of the Python environment that runs it, extras and plugins included. The same environment gives
the same bytes: no time, no random number.
"""

from __future__ import annotations

import json
import re
from importlib.metadata import Distribution, distributions
from typing import Any, Final
from uuid import NAMESPACE_URL, uuid5

OURS: Final = "cellwatt"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def sbom() -> dict[str, Any]:
    """The bill of materials, JSON-ready."""
    found = {normal(d.name): d for d in sorted(distributions(), key=lambda d: (normal(d.name), d.version))}
    content = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {"component": {**_component(found[OURS]), "type": "application"}},
        "components": [_component(d) for name, d in found.items() if name != OURS],
        "dependencies": [
            {"ref": purl(d), "dependsOn": [purl(found[name]) for name in requirements(d) if name in found]}
            for d in found.values()
        ],
    }
    serial = uuid5(NAMESPACE_URL, json.dumps(content, sort_keys=True))
    return {**content, "serialNumber": f"urn:uuid:{serial}"}


def normal(name: str) -> str:
    """A distribution's normalised name (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def purl(distribution: Distribution) -> str:
    """The distribution's package URL."""
    return f"pkg:pypi/{normal(distribution.name)}@{distribution.version}"


def requirements(distribution: Distribution) -> list[str]:
    """Names of a distribution's requirements, also those of extras and for other systems."""
    matches = (_NAME.match(text) for text in distribution.requires or ())
    return sorted({normal(match[0]) for match in matches if match} - {normal(distribution.name)})


def licence(distribution: Distribution) -> dict[str, Any]:
    """An entry of CycloneDX's ``licenses``: the SPDX expression if the distribution has one, otherwise its wording."""
    if expression := _stated(distribution, "License-Expression"):
        return {"expression": expression}
    classifiers = [c for c in distribution.metadata.get_all("Classifier") or () if c.startswith("License ::")]
    words = [c.rpartition(" :: ")[2] for c in classifiers] or _stated(distribution, "License").strip().splitlines()[:1]
    return {"license": {"name": " / ".join(words) or "not stated"}}


def _stated(distribution: Distribution, field: str) -> str:
    found = distribution.metadata.get_all(field) or [""]
    return str(found[0])


def _component(distribution: Distribution) -> dict[str, Any]:
    about = _stated(distribution, "Summary")
    return {
        "type": "library",
        "bom-ref": purl(distribution),
        "name": distribution.name,
        "version": distribution.version,
        **({"description": about} if about else {}),
        "licenses": [licence(distribution)],
        "purl": purl(distribution),
    }


if __name__ == "__main__":
    print(json.dumps(sbom(), indent=2, ensure_ascii=False, sort_keys=True))
