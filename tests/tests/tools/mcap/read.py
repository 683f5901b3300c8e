"""Reads a recording with the official reader: in order and by the index, checksums compared; validates its messages; prints them as JSON lines."""

import json
import sys

from jsonschema import Draft202012Validator
from mcap.reader import NonSeekingReader, SeekingReader

path = sys.argv[1]
with open(path, "rb") as file:
    in_order = [(channel.topic, message.log_time, message.data) for _, channel, message in NonSeekingReader(file, validate_crcs=True).iter_messages()]
with open(path, "rb") as file:
    reader = SeekingReader(file, validate_crcs=True)
    summary = reader.get_summary()
    by_index = list(reader.iter_messages())

assert sorted((channel.topic, message.log_time, message.data) for _, channel, message in by_index) == sorted(in_order)
assert summary.statistics.message_count == len(in_order)
assert summary.statistics.chunk_count == len(summary.chunk_indexes)
validators = {}
for schema, channel, message in by_index:
    if schema.id not in validators:
        text = json.loads(schema.data)
        Draft202012Validator.check_schema(text)
        validators[schema.id] = Draft202012Validator(text)
    value = json.loads(message.data)
    validators[schema.id].validate(value)
    line = {
        "topic": channel.topic,
        "encoding": [channel.message_encoding, schema.encoding],
        "schema": schema.name,
        "time": message.log_time,
        "value": value,
    }
    print(json.dumps(line))
