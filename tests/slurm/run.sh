#!/usr/bin/env bash
# Trains a dataset's bundle by Slurm array jobs on this machine, with the script of compressor/CLUSTER.md, and compares bytes with one process alone.
#   run.sh BIN DATASET OUT [options of compress]     BIN: the folder of the binary; OUT: a new folder
# Needs Debian's slurm-wlm and munge. Prints one line for each check; fails at the first that does not hold.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
export PATH="$1:$PATH"
dataset=$(cd "$2" && pwd)
mkdir "$3"
cd "$3"
options=("${@:4}")
sed -n '/^```bash$/,/^```$/p' "$here/../../compressor/CLUSTER.md" | sed '1d;$d' >compress.sh
[ "$(wc -l <compress.sh)" = 15 ]
"$here/cluster.sh" start "$PWD/cluster" 4
export SLURM_CONF=$PWD/cluster/slurm.conf
# (A job's output goes where sbatch is told by its environment.)
export SBATCH_OUTPUT=$PWD/task-%A-%a.txt SBATCH_NO_REQUEUE=
trap '"$here/cluster.sh" stop "$PWD/cluster"' EXIT

same() { cmp "$1" whole.ndgi && echo "same bytes: $2 ($(tail -n 1 "$3" | head -c 200))"; }
# Tenths of a second since some time.
now() { echo $((${EPOCHREALTIME/[.,]/} / 100000)); }
since() { local tenths=$(($(now) - $1)); echo "$((tenths / 10)).$((tenths % 10)) s"; }

begin=$(now)
compress "$dataset" "${options[@]}" --out whole.ndgi --json >whole.json 2>whole.txt
one=$(since "$begin")
echo "one process: $(grep -o '"tiles":[0-9]*' whole.json), $one"
for n in 1 3 7; do
    begin=$(now)
    # (A name that a shell must quote.)
    bash compress.sh "$n" "$dataset" "${options[@]}" --out "bündel $n.ndgi" >"$n.txt" 2>&1
    same "bündel $n.ndgi" "$n shards, $(since "$begin")" "$n.txt"
done

# A task and a node's daemon are killed while they work, and one shard runs twice at the same time.
bash compress.sh 7 "$dataset" "${options[@]}" --out killed.ndgi >killed.txt 2>&1 &
script=$!
until pgrep -f '^compress .* killed.ndgi --shard' >pids && [ "$(ls killed.ndgi.part/*.tile 2>/dev/null | wc -l)" -gt 2 ]; do
    sleep 0.05
done
compress "$dataset" "${options[@]}" --out killed.ndgi --shard 7/7 --quiet &
twice=$!
compress status "$dataset" --out killed.ndgi
kill -9 "$(head -n 1 pids)"
kill -9 "$(cat cluster/slurmd-n2.pid)"
sleep 3
slurmd -N n2
wait "$twice"
wait "$script" || { tail -n 5 killed.txt; exit 1; }
same killed.ndgi "a task and a daemon killed, a shard run twice; $(grep -c '^Submitted' killed.txt) arrays" killed.txt

# Towards a target.
compress "$dataset" "${options[@]}" --target-bpp 0.3 --out whole-target.ndgi --quiet >/dev/null
bash compress.sh 3 "$dataset" "${options[@]}" --target-bpp 0.3 --out target.ndgi >target.txt 2>&1
cmp target.ndgi whole-target.ndgi && echo "same bytes: a target by 3 shards; $(grep -c '^Submitted' target.txt) arrays"

# Bad input ends it at once.
code=0
bash compress.sh 3 "$dataset/no-such" --out bad.ndgi >bad.txt 2>&1 || code=$?
[ "$code" = 1 ] && [ "$(grep -c Submitted bad.txt)" = 1 ] && echo "bad input: exit code 1 after one array"
# As do nodes without the program.
code=0
SBATCH_EXPORT=NONE bash compress.sh 3 "$dataset" --out bad.ndgi >none.txt 2>&1 || code=$?
[ "$code" = 1 ] && [ "$(grep -c Submitted none.txt)" = 1 ] && echo "no program on the nodes: exit code 1 after one array"
[ -z "$(ls -d ./*.part 2>/dev/null)" ] && echo "no work folder is left"
