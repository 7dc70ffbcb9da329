#!/bin/sh
# In the guest, as a job of its systemd: the package of the earlier version as a service, a car on vcan0 that loses
# air, the upgrade, the removal. In: the two packages built in the clones below /srv. Out: a line STEP with seconds
# and name for each part, in /out/job.log; exit code 0 if all went well.
set -e
exec >>/out/job.log 2>&1
began=$(cut -d' ' -f1 /proc/uptime)
step() { # NAME: the time since the last one, for the table
    now=$(cut -d' ' -f1 /proc/uptime)
    echo "STEP $(awk "BEGIN {print $now - $began}") $1"
    began=$now
}
status() { tpmsd status --json 2>/dev/null; }
wait_for() { # SECONDS PATTERN: until the status shows it
    for _ in $(seq $1); do
        status | tr -d ' \n' | grep -qE "$2" && return
        sleep 1
    done
    echo "not within $1 s: $2"
    tpmsd status || true
    journalctl -u tpmsd --no-pager -o cat | tail -n 20
    exit 1
}
alarm='"kind":"(deflation|radius_deviation)"'

dpkg --force-unsafe-io -i /srv/earlier/build/deb/tpmsd_*.deb
step "install the package of the earlier version"

mkdir -p /run/udev; cd /run
chrt -f 10 /srv/earlier/.venv/bin/tpmsd simulate /run/car --duration 1200 --route test-track --seed 4 \
    --live vcan0 --pty /run/gnss --puncture rl --at 150 >/out/car.log 2>&1 &
car=$!
for _ in $(seq 60); do test -e /run/gnss && break; sleep 1; done
chgrp dialout "$(readlink -f /run/gnss)"; chmod 660 "$(readlink -f /run/gnss)"
mkdir -p /etc/tpmsd /etc/systemd/system/tpmsd.service.d
cp /run/car/bus.dbc /etc/tpmsd
cp /run/car/vehicle.toml /etc/tpmsd/tpmsd.toml
printf '\n[monitor]\nlearn_s = 10.0\n\n[state]\ninterval_s = 2.0\n' >>/etc/tpmsd/tpmsd.toml
printf '[Service]\nDeviceAllow=char-pts rw\n' >/etc/systemd/system/tpmsd.service.d/pty.conf
systemctl daemon-reload
tpmsd check /etc/tpmsd/tpmsd.toml
systemctl enable --now tpmsd
systemctl --no-pager status tpmsd
timeout 30 candump -L -n 3 vcan0,6F0:7FE
step "configure, enable --now: frames on vcan0"

wait_for 400 "$alarm"
tpmsd status
step "the car loses air: alarm in tpmsd status"
sleep 3
earlier=$(systemctl show --value -p MainPID tpmsd)

dpkg --force-unsafe-io -i /srv/tpmsd/build/deb/tpmsd_*.deb
sleep 5
now=$(systemctl show --value -p MainPID tpmsd)
echo "main process $earlier before the upgrade, $now after it"
test "$now" -ne 0
test "$now" -ne "$earlier"
wait_for 120 "$alarm"
tpmsd status
journalctl -u tpmsd --no-pager -o short | tail -n 20
journalctl -u tpmsd --no-pager -o cat | grep -q "taken up what was learned before"
systemctl is-enabled tpmsd
step "upgrade: restarted, the state taken up, the alarm stands"

dpkg -r tpmsd
if systemctl is-active tpmsd; then exit 1; fi
test ! -e /usr/bin/tpmsd
test -e /etc/tpmsd/tpmsd.toml
test -e /var/lib/private/tpmsd/state.json
dpkg -P tpmsd
test ! -e /var/lib/private/tpmsd
test -e /etc/tpmsd/tpmsd.toml
step "remove: service gone, configuration kept; purge: state gone"
kill $car
