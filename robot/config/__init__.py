"""Typed, strict configuration."""

from robot.config.base import MAX_SEED
from robot.config.loading import load_config
from robot.config.whole import Config

__all__ = ["MAX_SEED", "Config", "load_config"]
