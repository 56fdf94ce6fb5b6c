#!/usr/bin/env bash
# A new user's path, from a clone to an own drive, its picture and its fields.
#
#     bash tests/package/first_drive.sh REPOSITORY FOLDER [PYTHON]
#
# Without a Python that has DOLFINx, `./run` installs what is missing.
set -euo pipefail
repository=$1 folder=$2

mkdir -p "$folder"
tar -C "$repository" --exclude='./.git' --exclude='./.venv*' --exclude='./demos/output' -cf - . | tar -C "$folder" -xf -
cd "$folder"

if [[ $# -lt 3 ]]; then
    ./run test --collect-only -q >/dev/null
    python=$PWD/.venv/bin/python
else
    python=$3
fi

# The README's drive, with a load of one's own.
sed -n '/^```toml/,/^```$/p' README.md | sed -e '/^```/d' -e 's/^torque = 10.0/torque = 12.0/' >drive.toml
grep -q '^torque = 12.0' drive.toml
"$python" -m belt_fenicsx drive.toml --plot drive.png --out result
[[ -s drive.png && -s result/fields.csv && -s result/belt.vtu ]]
