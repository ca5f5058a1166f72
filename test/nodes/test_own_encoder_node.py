"""The encoder node with an encoder of another package."""

from __future__ import annotations

import array

import numpy as np
from live_nodes import Observer, StartNode, wait_until
from sensor_msgs.msg import Image, PointCloud2

from offradar_ros.nodes.encoder_node import EncoderNode
from offradar_ros.ros import qos
from offradar_ros.ros.embedding_message import embedding_record
from offradar_ros.ros.stamps import header


def test_the_node_answers_with_an_encoder_of_another_package(
    own_encoder: str, observer: Observer, start_node: StartNode
) -> None:
    node = start_node(EncoderNode, {'encoder.name': own_encoder})
    embeddings = observer.collect(PointCloud2, 'embedding', qos.RESULTS)
    send = observer.publisher(Image, 'radar_data/b_scan_image', qos.SCANS)
    wait_until(lambda: observer.node.count_publishers('embedding') == 1)
    power = np.random.default_rng(1).integers(1, 200, (400, 576), np.uint8)
    data = array.array('B', power.tobytes())
    send(Image(header=header(10**9, 'radar'), height=400, width=576, step=576, encoding='8UC1', data=data))
    wait_until(lambda: embeddings)
    assert embedding_record(embeddings[0], 'embedding').mean.shape == (64,)
    assert node.status.facts['model'] == own_encoder
