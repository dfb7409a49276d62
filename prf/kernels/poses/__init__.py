"""Moves of uncertain poses."""
