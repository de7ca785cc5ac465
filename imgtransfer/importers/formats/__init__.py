"""One module a kind of source that `imgtransfer import` reads; each has `jobs(paths, options)`."""
