"""Methods that predict a garment from a body in motion, behind one interface, so that they can be compared."""
