"""Embedding ↔ PointCloud2 of d points, and its model ↔ DiagnosticStatus.

Every embedding names its model by the full SHA-256, so that no receiver depends on the order of two topics.
"""

from __future__ import annotations

import json

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from sensor_msgs.msg import PointCloud2

from offradar_ros.encoders.protocol import ModelInfo
from offradar_ros.errors import RefusedInput
from offradar_ros.messages import stamp_ns
from offradar_ros.ros.clouds import from_cloud, to_cloud
from offradar_ros.ros.stamps import header
from offradar_ros.types import Embedding

POINT = np.dtype([('mean', '<f4'), ('variance', '<f4'), ('model', 'u1', (32,))])


def embedding_message(embedding: Embedding, frame_id: str) -> PointCloud2:
    """Width d; 0 for a scan that could not be encoded."""
    points = np.empty(len(embedding.mean), POINT)
    points['mean'], points['variance'] = embedding.mean, embedding.variance
    points['model'] = np.frombuffer(bytes.fromhex(embedding.model), np.uint8)
    return to_cloud(points, header(embedding.stamp_ns, frame_id))


def embedding_record(message: PointCloud2, topic: str) -> Embedding:
    """The embedding in a message; RefusedInput if its fields are not those of an embedding."""
    points = from_cloud(message, ['mean', 'variance', 'model'], topic)
    model = points['model'][0].tobytes().hex() if len(points) and points['model'].shape[1:] == (32,) else ''
    return Embedding(
        stamp_ns(message.header.stamp),
        points['mean'].astype(np.float32),
        points['variance'].astype(np.float32),
        model,
    )


def model_message(info: ModelInfo) -> DiagnosticStatus:
    """Name, fingerprint, dimension and metadata of a model."""
    values = {
        'fingerprint': info.fingerprint,
        'dimension': str(info.dimension),
        'metadata': json.dumps(dict(info.metadata)),
    }
    return DiagnosticStatus(
        level=DiagnosticStatus.OK,
        name=info.name,
        message=f'{info.name}, d = {info.dimension}',
        hardware_id=info.fingerprint,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )


def model_record(message: DiagnosticStatus, topic: str) -> ModelInfo:
    """The model in a message; RefusedInput('wrong_fields') if it is not one."""
    values = {item.key: item.value for item in message.values}
    try:
        metadata = {str(key): str(value) for key, value in json.loads(values['metadata']).items()}
        return ModelInfo(message.name, values['fingerprint'], int(values['dimension']), metadata)
    except (KeyError, ValueError, AttributeError) as error:
        raise RefusedInput(
            'wrong_fields', f'{topic}: expected fingerprint, dimension and metadata of a model'
        ) from error
