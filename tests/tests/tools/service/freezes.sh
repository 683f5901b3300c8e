#!/bin/sh
# Succeeds if a file system in a file can be mounted and frozen, in a namespace of its own.
set -e
image=$(mktemp)
trap 'rm -f "$image"' EXIT
truncate -s 1M "$image"
mkfs.ext4 -q "$image"
unshare -m sh -c "mount -o loop '$image' /mnt && fsfreeze --freeze /mnt && fsfreeze --unfreeze /mnt"
