"""Meshes in motion as maps and pictures."""
