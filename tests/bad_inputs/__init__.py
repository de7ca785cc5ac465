"""A generator of bad inputs: every command, every kind of file, seeded; what each must answer with.

`python tests/bad_inputs NAME ...` runs some by name or pattern, and tells how each went; `--list` prints the names.

`good` makes small good input of every kind, `readings` says which command reads which file, the modules that end in
`_faults` spoil files, `arguments` spoils command lines, `cases` puts all together, `worker` runs one in a process that
the supervisor can end, `verdict` judges the answer.
"""
