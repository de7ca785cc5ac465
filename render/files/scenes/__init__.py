"""Alembic and USD: files that hold many objects in motion, read by a process of their own that damage may end."""
