"""What fraction of a template's vertices its images show, image by image and all together."""

from __future__ import annotations

from dataclasses import dataclass

from render.maps.imager import TemplateImager


@dataclass(frozen=True)
class Coverage:
    """Fractions of the vertices, 0 to 1, that can be read from images (`TemplateImager.visible`).

    Args:
        images: the fraction that each image shows, by its camera's name; in the imager's order.
        together: (L,) the fraction that one image or another of layers 0 to k shows, for each layer k there is.
    """

    images: dict[str, float]
    together: tuple[float, ...]

    @classmethod
    def of(cls, imager: TemplateImager) -> Coverage:
        """The coverage of an imager's template."""
        names = [camera.name for camera in imager.cameras]
        layers = [camera.layer for camera in imager.cameras]
        together = []
        for deepest in range(max(layers) + 1):
            chosen = [layer <= deepest for layer in layers]
            together.append(float(imager.visible[chosen].any(axis=0).mean()))
        fractions = imager.visible.mean(axis=1).tolist()
        return cls(dict(zip(names, fractions, strict=True)), tuple(together))

    def __str__(self) -> str:
        """One line: "front 47.3 %, back 48.0 %; together 95.1 %"; two layers add "99.8 % with layer 1"."""
        images = ", ".join(f"{name} {100 * fraction:.1f} %" for name, fraction in self.images.items())
        deeper = [f"{100 * fraction:.2f} % with layer {k}" for k, fraction in enumerate(self.together) if k]
        return f"{images}; together {', '.join([f'{100 * self.together[0]:.2f} %', *deeper])}"
