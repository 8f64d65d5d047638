"""Mutation testing of the safety envelope."""
