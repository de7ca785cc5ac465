"""The deformer `image_transfer`: trained by `imgtransfer.training`, predicting by `imgtransfer.pipeline.deform`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

import numpy as np
import torch
from pydantic import Field, model_validator
from torch import Tensor

from imgtransfer.config.schema import Section
from imgtransfer.data.clip import Clip
from imgtransfer.deformers.base import Deformer, FitFolder
from imgtransfer.network.config import MapsConfig, NetworkConfig, check_laid_out
from imgtransfer.network.model import TransferModel
from imgtransfer.pipeline.deform import deform
from imgtransfer.training.checkpoint import (
    MODEL_FILE,
    MODEL_FORMAT,
    load_model,
    read_tensors,
    save_model,
    write_tensors,
)
from imgtransfer.training.config import DataConfig, RunConfig, TrainingConfig
from imgtransfer.training.loop import train
from imgtransfer.training.run_folder import CONFIG_FILE

_HEADER = "header"  # of a model's file, among its tensors: JSON in bytes
_COMMON = ("seed", "threads")  # every method has them at the top of its configuration


class ImageTransferConfig(Section):
    """The transfer networks with the fusion after them; without `method`, these sections stand at the top."""

    maps: MapsConfig = Field(MapsConfig(), description="How meshes become images.")
    network: NetworkConfig = Field(NetworkConfig(), description="The two transfer networks.")
    training: TrainingConfig = Field(
        TrainingConfig(), description="The optimisation; `seed` and `threads` are those at the top."
    )

    @model_validator(mode="after")
    def _common(self) -> ImageTransferConfig:
        for key in _COMMON:
            if getattr(self.training, key) != TrainingConfig.model_fields[key].default:
                raise ValueError(f"training.{key}: of a method it stands at the top of the file, as {key}")
        check_laid_out(self.maps, self.network, mirror=self.training.mirror)
        return self


class ImageTransfer(Deformer):
    """Maps predicted from maps (sections 3.1, 3.2), and vertices recovered from them (section 3.3)."""

    name: ClassVar[str] = "image_transfer"
    Config = ImageTransferConfig
    model: TransferModel

    @classmethod
    def of_file(cls, path: Path) -> ImageTransfer:
        """The method with a network that is trained already.

        Raises:
            InputError: as `imgtransfer.training.checkpoint.load_model`.
        """
        model = load_model(path)
        made = cls(ImageTransferConfig(maps=model.maps, network=model.network))
        made.model = model
        return made

    def fit(self, clips: Sequence[Clip], folder: FitFolder) -> None:
        """Train in the folder, or go on with the training there; the frames are read from `folder.data`.

        Raises:
            InputError: as `imgtransfer.training.train`.
            KeyboardInterrupt: after Ctrl-C or SIGTERM, once the state is saved.
            ValueError: `folder` does not say where the clips come from.
        """
        if folder.data is None:
            raise ValueError("image_transfer reads single frames, and needs FitFolder.data")
        config = self.run_config(folder.data, seed=folder.seed, threads=folder.threads)
        self.model = load_model(train(config, folder.path, resume=(folder.path / CONFIG_FILE).exists()))

    def run_config(self, data: DataConfig, *, seed: int, threads: int | None) -> RunConfig:
        """The network's training that fitting this method is."""
        assert isinstance(self.config, ImageTransferConfig)
        sections = self.config.model_dump()
        sections["training"] |= {"seed": seed, "threads": threads}
        return RunConfig.model_validate({"data": data.model_dump()} | sections)

    def predict(self, clip: Clip) -> np.ndarray:
        return deform(self.model, clip).fused

    def check(self, still: Clip) -> None:
        self.model.check_garment(still)

    def parameters(self) -> int:
        """Of both networks, and of the head where there is one."""
        return sum(value.numel() for value in self.model.state_dict().values())

    def tensors(self) -> dict[str, Tensor]:
        with TemporaryDirectory() as folder:
            tensors, header = read_tensors(save_model(Path(folder) / MODEL_FILE, self.model), MODEL_FORMAT)
        return tensors | {
            _HEADER: torch.frombuffer(bytearray(json.dumps(header).encode()), dtype=torch.uint8)
        }

    def restore(self, tensors: dict[str, Tensor]) -> None:
        header = json.loads(bytes(tensors[_HEADER].tolist()))
        weights = {key: value for key, value in tensors.items() if key != _HEADER}
        with TemporaryDirectory() as folder:
            self.model = load_model(write_tensors(Path(folder) / MODEL_FILE, weights, header))
