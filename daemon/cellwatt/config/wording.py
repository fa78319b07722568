"""Turns validation errors of pydantic into messages for the author of the file."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import islice
from typing import Any

from pydantic import ValidationError, WithJsonSchema
from pydantic_core import ErrorDetails

from cellwatt.config.document import Document
from cellwatt.config.fields import below, fields_at
from cellwatt.config.marks import LONGEST_VALUE, quoted, shortened
from cellwatt.config.places import MOST, KeyPath
from cellwatt.config.reference import written
from cellwatt.errors import Problem
from cellwatt.host import HIDDEN, blank

_LONGEST_WORD = 100  # characters of a key that are compared with known keys
_MOST_SIBLINGS = 200  # unknown keys that are checked for being a misspelt missing key

_UNKNOWN = ("extra_forbidden", "unexpected_keyword_argument")
_MISSING = ("missing", "missing_argument")
_SETTINGS, _LIST = _COLLECTIONS = "settings (key: value)", "a list"

_EXPECTED = {
    "int_parsing_size": "a smaller whole number",
    "none_required": "nothing",
    "path_not_file": "a file that exists (relative paths start at the folder of the settings file)",
    "path_not_directory": "a folder that exists (relative paths start at the folder of the settings file)",
    "greater_than": "a value above {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "a value below {lt}",
    "less_than_equal": "at most {le}",
    "string_too_short": "at least {min_length} characters",
    "string_too_long": "at most {max_length} characters",
    "too_short": "at least {min_length} entries",
    "too_long": "at most {max_length} entries",
    "string_pattern_mismatch": "text that matches {pattern}",
}
_KINDS = {"int": "a whole number", "float": "a number", "bool": "true or false", "string": "text", "path": "a path"}
_KINDS |= dict.fromkeys(("list", "tuple", "set", "frozen"), _LIST)
_KINDS |= dict.fromkeys(("dict", "mapping", "model", "dataclass"), _SETTINGS)
"""Expected value, by the first word of pydantic's error type."""


@dataclass(frozen=True, slots=True)
class _Finding:
    """One pydantic error, at a key path of the file; for a missing key, at the path that the key would have."""

    path: KeyPath
    error: ErrorDetails
    inside: KeyPath  # relative to the settings class

    @property
    def kind(self) -> str:
        return self.error["type"]


def nearest(word: object, choices: Iterable[str]) -> str | None:
    """The choice most similar to the word, ignoring case; None if none is similar."""
    by_lower = {choice.lower(): choice for choice in choices}
    near = difflib.get_close_matches(str(word)[:_LONGEST_WORD].lower(), by_lower, n=1)
    return by_lower[near[0]] if near else None


def did_you_mean(word: object, choices: Iterable[str]) -> str:
    """``"; did you mean 'host'?"`` if one of the choices is similar, else ``""``."""
    near = nearest(word, choices)
    return f"; did you mean {near!r}?" if near else ""


def unknown_key(key: object, choices: Sequence[str]) -> str:
    """Message for an unknown key."""
    return f"unknown key {quoted(key)}{did_you_mean(key, choices)} (keys here: {', '.join(choices)})"


def missing_key(key: str, description: str | None) -> str:
    """Message for a missing required key."""
    about = f" ({first_sentence(description)})" if description else ""
    return f"the key {key!r} is missing{about}"


def found(document: Document, path: KeyPath) -> str:
    """The value at a path, quoted for a message; never a secret or a value from the environment."""
    if path in document.environment:
        shown = document.environment[path]
        return shown if shown == HIDDEN else f"the value of {shown}"
    value = document.at(path)
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return _SETTINGS
    if isinstance(value, list):
        return _LIST
    as_is = document.places[path].written
    text = repr(as_is) if isinstance(value, str) else as_is
    return shortened(blank(text), LONGEST_VALUE)


def explain(
    error: ValidationError, model: Any, document: Document, section: KeyPath, reported: Collection[KeyPath]
) -> list[Problem]:
    """One problem per error in the mapping at ``section``, except at the key paths already ``reported``.

    Composes at most ``MOST`` + 1 messages: ``MOST`` are reported, and one more shows that there are others.
    """
    findings = [_located(details, document, section) for details in error.errors(include_url=False)]
    unknown = {f.path for f in findings if f.kind in _UNKNOWN}
    # pydantic drops invalid entries and then reports too few.
    above = {f.path[:i] for f in findings for i in range(len(f.path))}
    findings = [f for f in findings if f.kind != "too_short" or f.path not in above]
    grouped: dict[KeyPath, list[_Finding]] = {}
    for finding in findings:
        if finding.path not in reported and not _misspelt(finding, unknown):
            grouped.setdefault(finding.path, []).append(finding)
    worded = sorted(grouped.values(), key=lambda group: _order(group[0], document))[: MOST + 1]
    return [_problem(group, model, document) for group in worded]


def _order(finding: _Finding, document: Document) -> tuple[int, int]:
    place = document.places.get(finding.path) or document.places.get(finding.path[:-1])
    return place.key if place is not None else (0, 0)


def _located(error: ErrorDetails, document: Document, section: KeyPath) -> _Finding:
    path = section
    for part in error["loc"]:
        # Elements of the path that are not keys are pydantic's names for the members of a union.
        if (*path, part) in document.places:
            path = (*path, part)
    if error["type"] in _MISSING:
        path = (*path, error["loc"][-1])
    return _Finding(path, error, path[len(section) :])


def _misspelt(finding: _Finding, unknown: set[KeyPath]) -> bool:
    """True if an unknown key, which is reported already, is a misspelling of this missing key."""
    if finding.kind not in _MISSING:
        return False
    siblings = (str(u[-1]) for u in unknown if u[:-1] == finding.path[:-1])
    return any(nearest(s, [str(finding.path[-1])]) for s in islice(siblings, _MOST_SIBLINGS))


def _problem(group: Sequence[_Finding], model: Any, document: Document) -> Problem:
    first = group[0]
    if first.kind in _MISSING:
        text = missing_key(str(first.path[-1]), _described(model, first))
        return document.problem(first.path[:-1], text, at_key=True)
    if first.kind in _UNKNOWN:
        choices = list(fields_at(model, first.inside[:-1]))
        return document.problem(first.path, unknown_key(first.path[-1], choices), at_key=True)
    if first.kind == "invalid_key":
        return document.problem(
            first.path,
            f"the key {quoted(first.path[-1])} must be text: write it in quotes",
            at_key=True,
        )
    types = reduce(below, first.inside, [model])
    quantity = next((each.json_schema for each in types if isinstance(each, WithJsonSchema)), None)
    message = _value_message(group, document, quantity or {})
    if first.kind == "string_pattern_mismatch" and (about := _described(model, first)):
        message = f"{message} ({first_sentence(about)})"
    return document.problem(first.path, message)


def _described(model: Any, finding: _Finding) -> str | None:
    field = fields_at(model, finding.inside[:-1]).get(str(finding.path[-1]))
    return field.description if field else None


def _value_message(group: Sequence[_Finding], document: Document, quantity: Mapping[str, Any]) -> str:
    path = group[0].path
    shown = found(document, path) if path in document.places else "nothing"
    own = [_own_words(f.error) for f in group if f.kind in ("value_error", "assertion_error")]
    if own:
        return " or ".join(own) if shown in _COLLECTIONS else f"found {shown}: {' or '.join(own)}"
    expected = list(dict.fromkeys(_expected(f.error, quantity) for f in group))
    return f"found {shown}, expected {' or '.join(expected)}{_hint(group, document)}"


def _own_words(error: ErrorDetails) -> str:
    return " ".join(str(error.get("ctx", {}).get("error", error["msg"])).split())


def _expected(error: ErrorDetails, quantity: Mapping[str, Any]) -> str:
    template = _EXPECTED.get(error["type"]) or _KINDS.get(error["type"].partition("_")[0])
    context: Mapping[str, Any] = error.get("ctx", {})
    if template is None:
        text = error["msg"].removeprefix("Input should be ").removeprefix("Value should ")
        return " ".join(text.split())
    return template.format(**{key: written(v, quantity) if isinstance(v, float) else v for key, v in context.items()})


def _hint(group: Sequence[_Finding], document: Document) -> str:
    path = group[0].path
    if path not in document.places:
        return ""
    value = document.at(path)
    for finding in group:
        if finding.kind == "string_type" and isinstance(value, bool | int | float):
            return f'; write it in quotes: "{document.environment.get(path, document.places[path].written)}"'
        if finding.kind in ("literal_error", "enum") and isinstance(value, str):
            choices = re.findall(r"'([^']*)'", finding.error.get("ctx", {}).get("expected", ""))
            return did_you_mean(value, choices)
    return ""


def first_sentence(text: str) -> str:
    """First sentence of a description, without its full stop and code marks."""
    first = re.split(r"(?<=\w)(?<!e\.g)\.\s|\n\n|;", text.strip(), maxsplit=1)[0]
    return " ".join(first.split()).rstrip(", .").replace("``", "")
