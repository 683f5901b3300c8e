"""Every tag of a capture, from the secret alone (wire.md, Keys): of_tags.py hmac|cryptography|openssl CAPTURE.

A capture is the secret (32 bytes) and frames, each behind its length (u16, little-endian)."""

import hmac
import pathlib
import struct
import subprocess
import sys
from collections import Counter

WELCOME, REFUSAL, HELLO, CHALLENGE = 2, 7, 8, 9


def frames(data):
    while data:
        length = int.from_bytes(data[:2], "little")
        yield data[2 : 2 + length]
        data = data[2 + length :]


def of_hmac(key, text):
    return hmac.new(key, text, "sha256").digest()


def inputs(data):
    """Key, covered bytes and tag of each frame. Keys are derived with hmac."""
    secret = data[:32]
    key_id = of_hmac(secret, b"gantry-tau 2 key id")[:8]
    greeting = of_hmac(secret, b"gantry-tau 2 greeting")
    nonce = cookie = session = None
    for frame in frames(data[32:]):
        kind, covered, tag = frame[3], frame[:-16], frame[-16:]
        body = frame[8:-16]
        if kind == HELLO:
            assert body[4:12] == key_id, "another key"
            nonce, cookie = body[12:28], body[28:44]
            yield kind, greeting, covered, tag
        elif kind in (CHALLENGE, REFUSAL):
            yield kind, greeting, covered + nonce, tag
        else:
            if kind == WELCOME:
                epoch, _, _, _, axes, _, checksum = struct.unpack_from("<QQIBBHI", body)
                terms = struct.pack("<QBI", epoch, axes, checksum)
                session = of_hmac(secret, b"gantry-tau 2 session" + key_id + nonce + cookie + terms)
            yield kind, session, covered, tag


def by_hmac(all):
    return [of_hmac(key, text) for _, key, text, _ in all]


def by_cryptography(all):
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.hmac import HMAC

    def mac(key, text):
        one = HMAC(key, hashes.SHA256())
        one.update(text)
        return one.finalize()

    return [mac(key, text) for _, key, text, _ in all]


def by_openssl(all):
    """One process per key; each frame is a file, for openssl takes any number of them."""
    macs = {}
    for key in {key for _, key, _, _ in all}:
        names = []
        for number, (_, own, text, _) in enumerate(all):
            if own == key:
                pathlib.Path(str(number)).write_bytes(text)
                names.append(str(number))
        command = ["openssl", "dgst", "-sha256", "-mac", "HMAC", "-macopt", f"hexkey:{key.hex()}"]
        said = subprocess.run([*command, *names], check=True, capture_output=True, text=True).stdout
        for line in said.splitlines():
            name, mac = line.split("= ")
            macs[int(name.split("(")[1].rstrip(")"))] = bytes.fromhex(mac)
    return [macs[number] for number in range(len(all))]


implementation = {"hmac": by_hmac, "cryptography": by_cryptography, "openssl": by_openssl}[sys.argv[1]]
all = list(inputs(pathlib.Path(sys.argv[2]).read_bytes()))
differing = [kind for (kind, _, _, tag), mac in zip(all, implementation(all), strict=True) if mac[:16] != tag]
kinds = Counter(kind for kind, _, _, _ in all)
print(f"{sys.argv[1]}: {len(all)} frames, {len(differing)} differ; by kind {dict(sorted(kinds.items()))}")
assert len(all) >= 10_000 and set(kinds) >= {2, 3, 4, 5, 7, 8, 9}, "a capture of every kind"
assert not differing, f"of the kinds {set(differing)}"
