"""The paper's VGG-16 from one that was trained with batch normalisation. Needs torch."""

from __future__ import annotations

import dataclasses
import itertools

from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from offradar_ros.encoders.networks.backbone import Vgg16
from offradar_ros.encoders.networks.network import Network
from offradar_ros.encoders.networks.registry import make_network


def without_batch_norm(network: Network) -> Network:
    """`network` in evaluation mode; one of ``vgg16_bn`` becomes one of ``vgg16`` with the same outputs.

    A convolution W x + b that is normalised to γ (· − μ) / σ + β is a convolution with W' = γ W / σ and
    b' = γ (b − μ) / σ + β.
    """
    backbone = network.eval().features.backbone
    if network.config.backbone != 'vgg16_bn' or not isinstance(backbone, Vgg16):
        return network
    plain = make_network(dataclasses.replace(network.config, backbone='vgg16'))
    given, state = network.state_dict(), plain.state_dict()
    fused = (
        fuse_conv_bn_eval(layer, norm)
        for layer, norm in itertools.pairwise(backbone.features)
        if isinstance(layer, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d)
    )
    for name, layer in plain.named_modules():
        if isinstance(layer, nn.Conv2d) and 'backbone' in name:
            given |= {f'{name}.{part}': tensor for part, tensor in next(fused).state_dict().items()}
    plain.load_state_dict({name: given[name] for name in state})
    return plain.eval()
