"""From position and normal maps back to a mesh."""
