"""Garment deformation by image transfer: data, networks, training, metrics and the command line."""
