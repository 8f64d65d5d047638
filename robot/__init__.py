"""The robot: sees fruit, aims at it, doses it, and keeps account. See docs/house.md for the map of the rooms."""
