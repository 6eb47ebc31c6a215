#!/usr/bin/env bash
# Walks the whole way of a new user and writes docs/walkthrough.md from what the commands print.
#
#   cargo run -p xtask -- walkthrough [--quick]
#
# Clones the last commit of this checkout into a temporary folder and runs everything there, all tests included: about
# twenty minutes on two cores; --quick leaves the tests out and takes their headings from the script that runs them.
# Needs what testbenches/test-all.sh installs. Seconds and the temporary folder are left out of the page, so that it
# changes only when the tool does. Pictures go to docs/figures.
set -euo pipefail

source "$(dirname "$(realpath "$0")")/../common.sh"
quick=${1:-}
make_work
page=$work/walkthrough.md

say() {
  printf '%s\n' "$@" >> "$page"
}

# Leaves out what depends on the machine: seconds of stages and tests, cargo's lines, the temporary folder.
tidy() {
  sed -E -e 's/ +\([0-9.]+ s\)$//' -e "s|$work/||g" -e 's/; finished in [0-9.]+s//' \
    -e '/; about [0-9.]+ (s|min|h) to go$/d' -e 's/; about [0-9.]+ (s|min|h) on [0-9]+ threads?$//' \
    -e '/^ *(Compiling|Finished|Running|Downloading|Downloaded|Updating|Locking|Adding|Blocking) /d'
}

# Runs a command and shows it with its output, as far as the filter lets it through: `show STATUS COMMAND [FILTER]`.
show() {
  local expected=$1 command=$2 filter=${3:-cat} status=0
  bash -c "$command" > "$work/output" 2>&1 < /dev/null || status=$?
  if ((status != expected)); then
    cat "$work/output" >&2
    echo "walkthrough: exit code $status instead of $expected: $command" >&2
    exit 1
  fi
  say '' '```sh' "$command" '```' ''
  tidy < "$work/output" | bash -c "$filter" > "$work/shown"
  if [[ -s $work/shown ]]; then
    say '```text'
    cat "$work/shown" >> "$page"
    say '```'
  fi
  ((status == 0)) || say '' "The exit code is $status."
}

figure() {
  mkdir -p "$root/docs/figures"
  cp "$1" "$root/docs/figures/walkthrough_$2.svg"
  say '' "![$3](figures/walkthrough_$2.svg)"
}

git clone --quiet "$root" "$work/pe-synth"
cd "$work/pe-synth"

say '# A walk through pe-synth' '' \
  'From a fresh clone to verified hardware for your own model. `cargo run -p xtask -- walkthrough` runs every command on' \
  'this page and copies its output, without seconds and build lines, and of the tests without their numbers.' '' \
  '## The two commands' '' \
  'On Debian 12 with Rust and git, in a clone of the repository. The first compiles a lung of 4094 differential' \
  'equations to a network of 396 processing elements; the second installs what is missing and runs every test.'
show 0 'cargo run --release -- compile models/weibel11/weibel11.spec --pes 396 -o out/weibel11'
if [[ $quick == --quick ]]; then
  say '' '```sh' 'testbenches/test-all.sh' '```' '' '```text'
  sed -nE "s/^begin '?([^']*)'?\$/== \1/p" testbenches/test-all.sh >> "$page"
  say '```'
else
  show 0 'testbenches/test-all.sh' "grep '^==' | sed -E 's/ \([0-9]+ s\)$//'"
fi

cargo build --release --quiet
PATH=$(realpath -m "${CARGO_TARGET_DIR:-target}")/release:$PATH
export PATH
mkdir pumps
cp models/pump_station/motors.csv pumps/
sed 's|loss\*flow^2|los*flow^2|; s|\[W/K\]|[W]|' models/pump_station/pump_station.spec > pumps/pump_station.spec

say '' '## Your own model' '' \
  'The model is a test bench for a pump controller: two large pumps and a small one start on a weak supply and fill a' \
  'tank, and later the grid sags for 150 ms. 30 states: the fluxes of three induction motors in the frame that turns with the grid,' \
  '$\dot\psi_{qs} = v_q - R_s i_{qs} - \omega\psi_{ds}$ and so on, their shafts, pumps and windings, the supply, the' \
  'pipe and the tank, with products of speed and flux and squares of speed, current and flow. The spec' \
  'is one page, with the motor data in a CSV file. `pe-synth` now stands for' \
  '`target/release/pe-synth`.' '' \
  '```ode'
cat models/pump_station/pump_station.spec >> "$page"
say '```' '' '`pumps/motors.csv`:' '' '```csv'
cat models/pump_station/motors.csv >> "$page"
say '```' '' '## What a mistake looks like' '' \
  'Two typing errors: `los` for `loss`, and the unit of `cooling` is W instead of W/K.'
show 1 'pe-synth compile pumps/pump_station.spec --pes 8 -o out/pump_station'
cp models/pump_station/pump_station.spec pumps/

say '' '## From equations to hardware' '' \
  'With both fixed, `--reference` adds the total error, measured against a library for differential equations at a' \
  'tolerance of 1e-12.'
show 0 'pe-synth compile pumps/pump_station.spec --pes 8 --reference -o out/pump_station'
say '' 'The folder also has a page, `index.html`, and pictures. The outputs in fixed point over those in double precision:'
figure out/pump_station/pump_station_outputs.svg outputs 'outputs of the pump station over time'
say '' 'What each PE does in each cycle of a step:'
figure out/pump_station/pump_station_occupancy.svg occupancy 'occupancy of the processing elements'

say '' '## Is it the same in VHDL?' '' \
  '`verify` runs the VHDL in GHDL and the Rust reference, from several kinds of starts, and measures coverage.'
show 0 'pe-synth verify out/pump_station'

say '' '## Signals for a viewer' '' 'All outputs over the span as computed by the hardware, for GTKWave or similar viewers:'
show 0 'pe-synth sim pumps/pump_station.spec --pes 8 -o out/pump_station.vcd'

say '' '## Leaving out what is not needed' '' \
  'This test bench does not need the temperatures. Without them, three equations and everything that only they need are left out.'
show 0 'pe-synth compile pumps/pump_station.spec --pes 8 --observe w,torque,flow,level -o out/cold --quiet'
say '' 'The changes, as a check in continuous integration would report them:'
show 4 'pe-synth diff out/pump_station out/cold' "grep -v ' same\$'"

say '' '## Size, speed and error' '' '24 designs, each compiled completely:'
show 0 'pe-synth explore pumps/pump_station.spec --pes 1,2,4,8,16,30 --step 50us,25us --solver rk4 --multiplier 25x18,32x32 -o out/sweep'
figure out/sweep/error_time.svg error_time 'total error against run time of 24 designs'
figure out/sweep/size_speed.svg size_speed 'size against speed of 24 designs'

# The picture of the tutorial.
pe-synth compile models/lung/lung.spec --pes 3 --quiet -o out/lung
cp out/lung/lung_outputs.svg "$root/docs/figures/tutorial_outputs.svg"

mv "$page" "$root/docs/walkthrough.md"
