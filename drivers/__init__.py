"""Devices and bytes. Nothing here knows of tomatoes, missions or operators."""
