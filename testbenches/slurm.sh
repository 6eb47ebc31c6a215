#!/usr/bin/env bash
# A sweep of 1,000 points and a search through Slurm on one machine, with two nodes: a job is killed, a node drained, and the
# other one lost in the middle. No point may be missing, and the page must have the bytes of a sweep without Slurm.
#
#   testbenches/slurm.sh
#
# Needs slurmctld, slurmd, sbatch and munged (Debian: slurm-wlm, munge). Starts daemons of its own, which end with it, on the
# ports 16817 to 16819. $PE_SYNTH names a binary to use in place of building one. Results are in target/slurm.
set -euo pipefail

cd "$(dirname "$(realpath "$0")")/.."
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
if [[ -n ${PE_SYNTH:-} ]]; then
  pe_synth=$(realpath "$PE_SYNTH")
else
  cargo build --release --locked --quiet
  pe_synth=$target/release/pe-synth
fi
for tool in slurmctld slurmd sbatch munged; do
  command -v "$tool" > /dev/null || { echo "slurm.sh: $tool is missing: apt-get install slurm-wlm munge" >&2; exit 5; }
done
out=$target/slurm
rm -rf "$out"
mkdir -p "$out/state" "$out/log"
# A socket's path must be short, and munged wants its folders for itself.
run=$(mktemp -d)
chmod 755 "$run"
mkdir "$run/munge"

stop() {
  for pid in "$run"/*.pid "$run/munge/pid"; do
    if [[ -f $pid ]]; then kill "$(< "$pid")" 2> /dev/null || true; fi
  done
  sleep 1
  rm -rf "$run"
}
trap stop EXIT

(umask 077 && head -c 1024 /dev/urandom > "$run/munge/key")
as=()
if ((UID == 0)); then
  chown -R munge "$run/munge"
  as=(runuser -u munge --)
fi
"${as[@]}" munged --force --key-file "$run/munge/key" --socket "$run/munge/socket" --pid-file "$run/munge/pid" \
  --log-file "$run/munge/log" --seed-file "$run/munge/seed"
host=$(hostname -s)
export SLURM_CONF=$run/slurm.conf
cat > "$SLURM_CONF" << END
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
AuthType=auth/munge
AuthInfo=socket=$run/munge/socket
CredType=cred/munge
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
StateSaveLocation=$out/state
SlurmdSpoolDir=$out/spool-%n
SlurmctldPidFile=$run/slurmctld.pid
SlurmdPidFile=$run/slurmd-%n.pid
SlurmctldLogFile=$out/log/slurmctld.log
SlurmdLogFile=$out/log/slurmd-%n.log
SlurmdTimeout=10
ReturnToService=2
MpiDefault=none
JobRequeue=1
SchedulerParameters=sched_interval=2
NodeName=n[1-2] NodeHostname=$host NodeAddr=127.0.0.1 Port=[16818-16819] CPUs=1 State=UNKNOWN
PartitionName=all Nodes=n[1-2] Default=YES MaxTime=INFINITE State=UP
END
slurmctld -f "$SLURM_CONF"
slurmd -N n1 -f "$SLURM_CONF"
slurmd -N n2 -f "$SLURM_CONF"
for _ in $(seq 30); do
  if [[ $(sinfo --noheader --format=%T) == idle ]]; then break; fi
  sleep 1
done
sinfo

model=models/van_der_pol/van_der_pol.spec
lists=(--solver euler,heun,heun3,rk4,ab4 --step 50ms,40ms,25ms,20ms,12.5ms,10ms,8ms,5ms,4ms,2.5ms
  --multiplier 18x18,25x18,18x25,32x32,35x35 --storage 32,40 --pes 1,2 --span 300s --quiet)
goal=(--max-error 1e-4 --span 20s --quiet)
"$pe_synth" explore "$model" "${lists[@]}" -o "$out/whole"
"$pe_synth" accuracy "$model" "${goal[@]}" -o "$out/searched"

printf '\n== 1,000 points (%d s)\n' "$SECONDS"
"$pe_synth" explore "$model" "${lists[@]}" --store "$out/store" --cluster slurm --parts 20 -o "$out/merged" &
sweep=$!
victim=
until [[ -n $victim ]] && scancel --full --signal=KILL "$victim" 2> /dev/null; do
  sleep 0.2
  victim=$(squeue --noheader --states=R --format=%i | head -1)
done
echo "killed $victim"
scontrol update nodename=n2 state=drain reason=test
sleep 3
scontrol update nodename=n2 state=resume
echo "drained n2 and took it back"
sleep 2
kill -9 "$(< "$run/slurmd-n1.pid")"
rm "$run/slurmd-n1.pid"
echo "lost n1"
wait "$sweep"
squeue
diff -r "$out/whole" "$out/merged"
printf 'equal bytes; points: %s\n' "$(find "$out/store" -name '*.json' | wc -l)"

printf '\n== a search in rounds (%d s)\n' "$SECONDS"
"$pe_synth" accuracy "$model" "${goal[@]}" --store "$out/store" --cluster slurm --parts 4 -o "$out/searched_in_rounds"
diff -r "$out/searched" "$out/searched_in_rounds"
printf 'equal bytes (%d s)\n' "$SECONDS"
