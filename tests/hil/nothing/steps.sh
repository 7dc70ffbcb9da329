# The commands of README, docs/tutorial and docs/how-to/running.md, in their order, as root in a new Debian.
# A line `#= NAME` begins a step; each is run by a shell of its own, with -e, and $EARLIER set. The sources come
# as a bundle, a recorded drive as /srv/recording.

#= apt-get install git make python3-venv
apt-get -q update
apt-get -qy install --no-install-recommends git make python3-venv

#= git clone
git clone -q /srv/tpmsd.bundle /srv/tpmsd

#= make demo
cd /srv/tpmsd
make demo

#= pip install -e '.[report]'
cd /srv/tpmsd
.venv/bin/pip install -q -e '.[report]'

#= first alarm: simulate, check, replay, explain
cd /srv
. tpmsd/.venv/bin/activate
tpmsd simulate drives/first --duration 600 --puncture rl --at 300 --seed 1
tpmsd check drives/first/vehicle.toml
tpmsd replay drives/first --plot first.png --html first.html --json first.json
tpmsd explain drives/first
ls -l first.png first.html
grep -q '"deflation"' first.json

#= what is left out: simulate, diagnose, replay --model
cd /srv
. tpmsd/.venv/bin/activate
tpmsd simulate drives/real --duration 400 --seed 5 --effect centrifugal_growth:coefficient=2.1e-6 \
    --effect gnss_latency:latency_s=0.15
tpmsd diagnose drives/real --model-out model.toml --html real.html --certify 0
tpmsd replay drives/real --model model.toml
grep -q centrifugal_growth model.toml

#= discover on a recording
cd /srv
. tpmsd/.venv/bin/activate
mkdir car
tpmsd discover recording --write car/vehicle.toml --json found.json
tpmsd check car/vehicle.toml
grep -q wheel_ car/vehicle.toml

#= first report: diagnose the recording
cd /srv
. tpmsd/.venv/bin/activate
tpmsd diagnose recording --html report.html --json report.json
ls -l report.html report.json

#= nox: the wheel as built, in a clean environment
cd /srv/tpmsd
.venv/bin/pip install -q nox
.venv/bin/nox -s wheel

#= make install
cd /srv/tpmsd
make install
cd /
tpmsd --version
tpmsd check /srv/drives/first

#= make uninstall
cd /srv/tpmsd
make uninstall
test ! -e /usr/local/bin/tpmsd
test ! -e /opt/tpmsd

#= apt-get install debhelper dpkg-dev
apt-get -qy install --no-install-recommends debhelper dpkg-dev

#= make deb
cd /srv/tpmsd
make deb

#= apt install the package, and purge it
cd /srv/tpmsd
apt-get -qy install ./build/deb/tpmsd_*.deb
tpmsd --version
test -e /usr/share/man/man1/tpmsd.1.gz
apt-get -qy purge tpmsd
test ! -e /usr/bin/tpmsd

#= make deb of the earlier version
git clone -q /srv/tpmsd.bundle /srv/earlier
cd /srv/earlier
git checkout -q "$EARLIER"
make deb

#= what the guest takes
apt-get -qy install --no-install-recommends systemd systemd-sysv libnss-systemd udev dbus kmod iproute2 \
    can-utils util-linux procps
