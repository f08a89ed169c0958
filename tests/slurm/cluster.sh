#!/usr/bin/env bash
# A Slurm cluster on this machine, for tests: no systemd, no database, no cgroups. Needs Debian's slurm-wlm and munge.
#   cluster.sh start DIR NODES    then   export SLURM_CONF=DIR/slurm.conf
#   cluster.sh stop DIR
set -euo pipefail
what=$1
dir=$(mkdir -p "$2" && cd "$2" && pwd)
if [ "$what" = stop ]; then
    for file in "$dir"/*.pid; do
        kill "$(cat "$file")" 2>/dev/null || true
    done
    exit
fi
nodes=$3
host=$(hostname -s)
port=$((20000 + RANDOM % 20000))
mkdir -p "$dir/state" "$dir/log"
(umask 077 && head -c 1024 /dev/urandom >"$dir/munge.key")
munged --force --key-file="$dir/munge.key" --socket="$dir/munge.socket" --pid-file="$dir/munged.pid" --log-file="$dir/log/munged" \
    --seed-file="$dir/munge.seed"
# (Credentials expire after 5 s: that is also the shortest wait before a requeued job starts again, 120 s by default.)
cat >"$dir/slurm.conf" <<CONF
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$port
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
AuthInfo=socket=$dir/munge.socket,cred_expire=5
CredType=cred/munge
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=bf_interval=1,sched_interval=1,batch_sched_delay=1
MpiDefault=none
SwitchType=switch/none
ReturnToService=2
SlurmdTimeout=10
SlurmdParameters=config_overrides
SlurmctldPidFile=$dir/slurmctld.pid
SlurmdPidFile=$dir/slurmd-%n.pid
StateSaveLocation=$dir/state
SlurmdSpoolDir=$dir/spool-%n
SlurmctldLogFile=$dir/log/slurmctld
SlurmdLogFile=$dir/log/slurmd-%n
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
for node in $(seq "$nodes"); do
    mkdir -p "$dir/spool-n$node"
    echo "NodeName=n$node NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + node)) CPUs=1 RealMemory=4000"
done >>"$dir/slurm.conf"
# (Partitions come after their nodes.)
grep '^Partition' "$dir/slurm.conf" >"$dir/partition" && sed -i '/^Partition/d' "$dir/slurm.conf" && cat "$dir/partition" >>"$dir/slurm.conf"
export SLURM_CONF=$dir/slurm.conf
slurmctld -i
for node in $(seq "$nodes"); do
    slurmd -N "n$node"
done
for _ in $(seq 120); do
    if [ "$(sinfo -hN -t idle -o %N 2>/dev/null | wc -l)" = "$nodes" ]; then
        exit
    fi
    sleep 0.25
done
echo "the cluster did not come up; logs:" >&2
tail -n 5 "$dir"/log/* >&2
exit 1
