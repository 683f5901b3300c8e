#!/bin/bash -eu
# Every target with its seeds and its dictionary, as OSS-Fuzz and ClusterFuzzLite want them. Not run where this was written.
cd "$SRC/gantry-tau/fuzz"
cargo fuzz build -O --debug-assertions
for target in $(cargo fuzz list); do
    cp "target/x86_64-unknown-linux-gnu/release/$target" "$OUT/"
    zip -q -j "$OUT/${target}_seed_corpus.zip" "seeds/$target/"*
    if [ -f "dictionaries/$target.dict" ]; then
        cp "dictionaries/$target.dict" "$OUT/$target.dict"
    fi
done
