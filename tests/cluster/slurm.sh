#!/usr/bin/env bash
# A Slurm cluster of two nodes on this machine, loopback only: `slurm.sh start FOLDER`, `slurm.sh stop FOLDER`.
# Needs Debian's slurm-wlm (apt-get install slurm-wlm) and root. No systemd, munge or database.
# The configuration must lie at the system's place, /etc/slurm/slurm.conf: Snakemake's executor wipes SLURM_* when a job starts, and the
# job's own srun then looks there. One that is there already and not by this script is left alone.
set -euo pipefail
action=${1:?start or stop}
folder=$(realpath -m "${2:?a folder for logs and state}")
conf=/etc/slurm/slurm.conf
mark="# written by tests/cluster/slurm.sh"

stop() {
    if [ -f $conf ] && grep -q "^$mark" $conf; then timeout 10 scancel --user="$(id -un)" 2>/dev/null || true; fi
    for pid in "$folder"/*.pid; do
        [ -e "$pid" ] && kill "$(cat "$pid")" 2>/dev/null || true
    done
    sleep 1
    if [ -f $conf ] && grep -q "^$mark" $conf; then rm -f $conf; fi
}

start() {
    if [ -f $conf ] && ! grep -q "^$mark" $conf; then
        echo "$conf is there already and not by this script" >&2
        exit 2
    fi
    mkdir -p "$folder" "$folder/state" "$folder/spool-n1" "$folder/spool-n2" /etc/slurm
    local host
    host=$(hostname -s)
    cat > $conf <<CONF
$mark
ClusterName=aloft
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
SlurmUser=root
SlurmdUser=root
AuthType=auth/none
CredType=cred/none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
JobCompType=jobcomp/filetxt
JobCompLoc=$folder/jobs.txt
MinJobAge=3600
ReturnToService=2
SlurmdTimeout=20
SchedulerParameters=sched_interval=2,batch_sched_delay=1,defer
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool-%n
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd-%n.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd-%n.log
NodeName=n1 NodeHostname=$host NodeAddr=127.0.0.1 Port=16821 CPUs=16 RealMemory=8000
NodeName=n2 NodeHostname=$host NodeAddr=127.0.0.1 Port=16822 CPUs=16 RealMemory=8000
PartitionName=main Nodes=n1,n2 Default=YES LLN=YES MaxTime=INFINITE State=UP
CONF
    slurmctld -c
    slurmd -N n1
    slurmd -N n2
    for _ in $(seq 30); do
        [ "$(sinfo -h -t idle -o %D 2>/dev/null)" = 2 ] && break
        sleep 1
    done
    sinfo
}

case $action in
    start) start ;;
    stop) stop ;;
    *) echo "start or stop" >&2; exit 2 ;;
esac
