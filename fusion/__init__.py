"""From position and normal maps back to a mesh."""

from fusion.sdf import BodySdf as BodySdf
