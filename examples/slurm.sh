#!/bin/bash
# One mission as a SLURM job: a scheduler and the run on the job's first node, a worker on every task.
#
#   sbatch examples/slurm.sh mission.nc petrel-l mission.zarr
#
#SBATCH --job-name=gliderhpc
#SBATCH --ntasks=32
#SBATCH --cpus-per-task=1
#SBATCH --mem-per-cpu=2G
#SBATCH --time=04:00:00
#SBATCH --signal=B:TERM@120
#SBATCH --requeue
set -u
observations=$1 platform=$2 archive=$3
export OMP_NUM_THREADS=1
# Freed memory stays with the workers, where dask's own setting hands every array back to the kernel.
export MALLOC_TRIM_THRESHOLD_=268435456 MALLOC_MMAP_THRESHOLD_=33554432

# On the file system that all nodes share, as the archive and the observations are; nobody else can look into it.
folder="$PWD/.gliderhpc-$SLURM_JOB_ID"
umask 077
mkdir -p "$folder"
chmod 700 "$folder"

# Whoever reaches a port of a Dask cluster can run code as you, so take nobody without this job's own certificate.
openssl req -x509 -newkey rsa:2048 -nodes -days 30 -subj /CN=gliderhpc -keyout "$folder/key.pem" \
    -out "$folder/certificate.pem" 2> "$folder/openssl.log" || exit 1
export DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION=True
export DASK_DISTRIBUTED__COMM__TLS__CA_FILE="$folder/certificate.pem"
for role in SCHEDULER WORKER CLIENT; do
    export "DASK_DISTRIBUTED__COMM__TLS__${role}__CERT=$folder/certificate.pem"
    export "DASK_DISTRIBUTED__COMM__TLS__${role}__KEY=$folder/key.pem"
done
# What dask shows over HTTP has no certificate: on loopback alone, and nothing of it.
export DASK_DISTRIBUTED__SCHEDULER__HTTP__ROUTES="[]" DASK_DISTRIBUTED__WORKER__HTTP__ROUTES="[]"

rm -f "$folder/scheduler.json"
dask scheduler --protocol tls --port 0 --no-dashboard --dashboard-address 127.0.0.1:0 --scheduler-file "$folder/scheduler.json" 2> "$folder/scheduler.log" &
scheduler=$!
# On a busy node or a slow file system this takes longer than the run would wait.
until [ -s "$folder/scheduler.json" ]; do
    kill -0 "$scheduler" 2> /dev/null || { tail -n 5 "$folder/scheduler.log" >&2; exit 1; }
    sleep 0.2
done
srun dask worker --protocol tls --no-dashboard --dashboard-address 127.0.0.1:0 --nthreads 1 --scheduler-file "$folder/scheduler.json" \
    --local-directory "${TMPDIR:-/tmp}" 2> "$folder/workers.log" &
workers=$!

# Resuming an archive that is not there yet begins it, so the same line starts and goes on.
gliderhpc run-mission "$observations" --platform "$platform" --store "$archive" --resume \
    --scheduler-file "$folder/scheduler.json" --log-file "$archive.log" &
run=$!

# Two minutes before the time is up SLURM sends SIGTERM to this script: hand it on and wait for the run to end cleanly.
trap 'kill -TERM "$run"' TERM
wait "$run"
status=$?
while kill -0 "$run" 2> /dev/null; do
    wait "$run"
    status=$?
done
trap - TERM
kill "$workers" "$scheduler" 2> /dev/null

case $status in
    0) echo "done" ;;
    1) echo "some profiles failed, or the run had to stop: see $archive.log" ;;
    2) echo "the input cannot be used: see the line above" ;;
    130) echo "interrupted: queued again to go on"
         scontrol requeue "$SLURM_JOB_ID" ;;
esac
exit "$status"
