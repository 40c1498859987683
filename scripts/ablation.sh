#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# The paper's table of ablations (its seven experiments) and ours: trains each variant of a network, unless its weights
# are there already, and compares all on the test samples.
#
# Usage: scripts/ablation.sh BRACE FOLDER [MODEL]
#   BRACE    the program; FOLDER: where scripts/train.sh works, with its sets; MODEL: brace-s
# Variants end up in FOLDER/ablation/NAME-stageN, tables in FOLDER/ablation/table.{txt,csv,html} and sheet.png.
# For a quick look, or a part: EPOCHS (instead of the configuration's: of each stage, or two numbers), SAMPLES (of an
# epoch), CROP (packed pixels a side), COUNT (test samples), VARIANTS (names below), PROCESSES (as for train.sh).
set -euo pipefail
[ $# -ge 2 ] || { sed -n '3,10s/^# \{0,1\}//p' "$0"; exit 2; }
brace=$(realpath "$1") here=$(cd "$(dirname "$0")" && pwd)
configs=$(realpath "$here/../data/configs")
cd "$2"
model=${3:-brace-s}
for stage in 1 2; do
    [ -f "$configs/$model-stage$stage.json" ] || { echo "there is no configuration $model-stage$stage.json" >&2; exit 2; }
done
for set in varied more field; do
    [ -d sets/$set/packed ] || { echo "$2/sets/$set/packed is not there: run scripts/train.sh first" >&2; exit 1; }
done
mkdir -p ablation

# name, what differs in stage one, in stage two; no stage two: "-". Its beginning is the stage one of `from`, if named.
#   MWL: the multi-level wavelet loss
all='
1-neither     {"network":{"mscam":false},"loss":{"wavelet":0}}  -
2-mscam       {"loss":{"wavelet":0}}                            -
3-mwl         {"network":{"mscam":false}}                       -
4-both        {}                                                -
5-color-only  from:4-both                                       {"loss":{"l1":false}}
6-l1-only     from:4-both                                       {"loss":{"color":0}}
7-all         from:4-both                                       {}
no-mscam      from:3-mwl                                        {"network":{"mscam":false}}
no-prior      {"network":{"prior":false}}                       {"network":{"prior":false}}
no-gate       {"network":{"gate":false}}                        {"network":{"gate":false}}
strip         {"network":{"strip":64}}                          {"network":{"strip":64}}
'

# config NAME STAGE CHANGES [INITIAL]: the model's configuration, changed.
config() {
    python3 - "$configs/$model-stage$2.json" "$3" "${4:-}" "$2" <<'PYTHON' > "ablation/$1-stage$2.json.part"
import json, os, sys
config, changes = json.load(open(sys.argv[1])), json.loads(sys.argv[2])
for key, value in changes.items():
    config.setdefault(key, {}).update(value)
config.pop("initial", None)
if sys.argv[3]:
    config["initial"] = sys.argv[3]
if os.environ.get("EPOCHS"):
    config["epochs"] = int(os.environ["EPOCHS"].split()[0 if sys.argv[4] == "1" else -1])
if os.environ.get("SAMPLES"):
    config["epoch_samples"] = int(os.environ["SAMPLES"])
if os.environ.get("CROP"):
    config["data"]["crop"] = int(os.environ["CROP"])
optimizer = config.get("optimizer", {})
if optimizer.get("warmup_epochs", 0) >= config["epochs"]:
    optimizer["warmup_epochs"] = 0
config["description"] = "An ablation."
print(json.dumps(config, indent=4))
PYTHON
    mv "ablation/$1-stage$2.json.part" "ablation/$1-stage$2.json"
}

train() { # NAME STAGE
    "$here/train_run.sh" "$brace" "ablation/$1-stage$2.json" "ablation/$1-stage$2"
}

stage_one() { # NAME CHANGES
    [ -f "ablation/$1-stage1.json" ] || config "$1" 1 "$2"
    train "$1" 1
}

methods=reference,merge
while read -r name one two; do
    [ -n "$name" ] || continue
    [[ -z ${VARIANTS:-} || " $VARIANTS " == *" $name "* ]] || continue
    from=$name
    if [[ $one == from:* ]]; then
        from=${one#from:}
        one=$(awk -v n="$from" '$1 == n { print $2 }' <<< "$all")
    fi
    stage_one "$from" "$one"
    weights=ablation/$from-stage1/weights.safetensors
    if [ "$two" != - ]; then
        [ -f "ablation/$name-stage2.json" ] || config "$name" 2 "$two" "$weights"
        train "$name" 2
        weights=ablation/$name-stage2/weights.safetensors
    fi
    methods+=,$name=$weights
done <<< "$all"

"$brace" eval --data sets/field/set --method "$methods" ${COUNT:+--count "$COUNT"} --csv ablation/table.csv \
    --html ablation/table.html --sheet ablation/sheet.png > ablation/table.txt.part
mv ablation/table.txt.part ablation/table.txt
cat ablation/table.txt
