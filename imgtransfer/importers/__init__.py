"""Everyone's formats, read into clips: one module a format, and what they share."""
