"""TOML in, frozen models out, every wrong value named with its path and a remedy.

Environment variables override single values: ``SPRAYER_DOSING__MAX_ML=7``.
"""

from __future__ import annotations

import difflib
import os
import re
import tomllib
from pathlib import Path
from typing import Any, get_args

from pydantic import ValidationError
from pydantic_settings import SettingsError

from robot.config.whole import ENVIRONMENT, Config
from robot.errors import ConfigError
from robot.package_files import config_file


def load_config(path: Path) -> Config:
    """Read, check and freeze a configuration file; ``ConfigError`` names file, key, what was found and the remedy."""
    found = config_file(path)
    try:
        with found.open("rb") as stream:
            raw = tomllib.load(stream)
    except OSError as error:
        raise ConfigError(f"{found}: cannot be read ({error.strerror}); check the path and its permissions") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{found}: not valid TOML ({error}); mend that line") from error
    _check_environment()
    try:
        return Config(**raw)
    except ValidationError as error:
        raise ConfigError(f"{found}: " + "; ".join(_explain(item) for item in error.errors())) from error
    except SettingsError as error:
        raise ConfigError(f"environment: {error}; set single values, like {ENVIRONMENT}TWIN__HOUR=19") from error


def _check_environment() -> None:
    """A section that is misspelt in a variable's name would be passed over in silence: refuse it."""
    for name in os.environ:
        section, separator, _ = name.upper().removeprefix(ENVIRONMENT).lower().partition("__")
        if name.upper().startswith(ENVIRONMENT) and separator and section not in Config.model_fields:
            near = difflib.get_close_matches(section, Config.model_fields, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"sections are: {', '.join(Config.model_fields)}"
            raise ConfigError(f"environment variable {name}: no section '{section}'; {hint}")


def _explain(item: Any) -> str:
    location = _without_tags(item["loc"])
    path = ".".join(str(part) for part in location) or "configuration"
    if item["type"] == "extra_forbidden":
        known = _keys_at(item["loc"][:-1])
        near = difflib.get_close_matches(str(item["loc"][-1]), known, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"known keys here: {', '.join(sorted(known))}"
        return f"unknown key '{path}'; {hint}"
    if item["type"] == "missing":
        return f"'{path}' is missing; add it"
    if item["type"] == "union_tag_not_found":
        return f"'{path}.backend' is missing; add it"
    if item["type"] == "union_tag_invalid":
        return f"'{path}.backend': expected one of {item['ctx']['expected_tags']}, found '{item['ctx']['tag']}'"
    message = str(item["msg"]).removeprefix("Value error, ")
    if item["type"] == "literal_error" and isinstance(item["input"], str):
        known = re.findall(r"'([^']*)'", item["ctx"]["expected"])
        near = difflib.get_close_matches(item["input"], known, n=1)
        return f"'{path}': {message}, found '{item['input']}'" + (f"; did you mean '{near[0]}'?" if near else "")
    found = "" if isinstance(item["input"], dict) else f", found {item['input']!r}"
    return f"'{path}': {message}{found}"


def _without_tags(location: tuple[Any, ...]) -> tuple[Any, ...]:
    """The keys of the file: where a section has several back ends, the chosen one stands behind the section's name."""
    if len(location) > 1 and _variants(location[0]):
        return (location[0], *location[2:])
    return location


def _variants(section: Any) -> dict[str, Any]:
    """The models of a section by back end; {} for a section that has one model only."""
    field = Config.model_fields.get(section)
    models = get_args(field.annotation) if field is not None else ()
    return {get_args(model.model_fields["backend"].annotation)[0]: model for model in models}


def _keys_at(location: tuple[Any, ...]) -> list[str]:
    model: Any = Config
    for number, part in enumerate(location):
        if number == 1 and (variants := _variants(location[0])):
            model = variants.get(part)
            continue
        field = model.model_fields.get(part) if hasattr(model, "model_fields") else None
        model = field.annotation if field is not None else None
        if args := get_args(model):  # a table that may be left out
            model = next((arg for arg in args if hasattr(arg, "model_fields")), None)
    return list(model.model_fields) if hasattr(model, "model_fields") else []
