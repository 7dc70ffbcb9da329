#!/bin/sh
# Process 1 of the guest: User Mode Linux with the machine's own files below and nothing written to them.
# In (words of the kernel's command line): HIL_STAGE, a tree mounted over the machine's (the installed package);
# HIL_OUT, the one folder that the outside sees, as /out; HIL_JOB, a shell script; HIL_MODE, `plain` or
# `systemd`; HIL_DISK, a block device to mount as /disk, if any. Out: /out/status with the job's exit code.
PATH=/usr/sbin:/usr/bin:/sbin:/bin
HOME=/root
export PATH HOME

power_off() {
    sync
    echo o >/proc/sysrq-trigger || echo o >proc/sysrq-trigger
    sleep 60
}

fail() {
    echo "init: $*"
    power_off
}

mount -t proc proc /proc && mount -t sysfs sys /sys && mount -t tmpfs -o size=90% tmpfs /mnt || fail "no file systems"
modules=/usr/lib/uml/modules/$(uname -r)/kernel
for module in fs/overlayfs/overlay net/can/can drivers/net/can/dev/can-dev net/can/can-raw net/can/can-bcm \
    drivers/net/can/vcan; do
    insmod "$modules/$module.ko" || fail "no module $module"
done

# The stage is mounted apart: an overlay takes no layer that lies within another.
mkdir /mnt/upper /mnt/work /mnt/root /mnt/stage
mount -t hostfs -o "$HIL_STAGE" none /mnt/stage || fail "no stage"
mount -t overlay -o lowerdir=/mnt/stage:/,upperdir=/mnt/upper,workdir=/mnt/work overlay /mnt/root || fail "no overlay"
cd /mnt/root || fail "no root"
mkdir -p out disk
mount -t hostfs -o "$HIL_OUT" none out || fail "no /out"
mount -n --move /dev dev && mount -n --move /proc proc && mount -n --move /sys sys || fail "cannot move"
mount -t tmpfs -o mode=755 tmpfs run
mkdir -p dev/shm dev/pts
mount -t tmpfs tmpfs dev/shm
mount -t devpts -o ptmxmode=666,gid=5,mode=620 devpts dev/pts
rm -f dev/ptmx && ln -s pts/ptmx dev/ptmx
if [ -n "$HIL_DISK" ]; then
    mount -t ext4 "dev/$HIL_DISK" disk || fail "no disk"
fi

ip link set lo up
ip link add dev vcan0 type vcan && ip link set vcan0 mtu 72 up || fail "no vcan"
mkdir -p mnt/machine
pivot_root . mnt/machine || fail "cannot pivot"

if [ "$HIL_MODE" = plain ]; then
    chroot . /bin/sh "$HIL_JOB"
    echo $? >/out/status
    umount /disk 2>/dev/null
    power_off
fi

# --- systemd: what would keep it from starting, or cost time, on a machine that it does not own
# (and what a tpmsd of this machine may have left)
rm -rf .dockerenv etc/.pwd.lock etc/tpmsd var/lib/tpmsd* usr/sbin/policy-rc.d
: >etc/fstab
rm -rf etc/systemd/system/*.wants etc/systemd/system/*.requires etc/machine-id
printf '%032d\n' 7 | tr 0 a >etc/machine-id
mkdir -p var/lib/private var/cache/private var/log/private
for folder in lib cache log; do
    mount -t tmpfs -o mode=700 tmpfs "var/$folder/private"
done
for unit in systemd-logind.service systemd-timesyncd.service systemd-tmpfiles-setup.service \
    systemd-tmpfiles-setup-dev.service systemd-tmpfiles-clean.timer systemd-sysctl.service \
    systemd-random-seed.service systemd-modules-load.service systemd-journal-flush.service \
    systemd-udev-trigger.service systemd-hwdb-update.service systemd-sysusers.service ldconfig.service \
    systemd-remount-fs.service systemd-binfmt.service proc-sys-fs-binfmt_misc.automount \
    dev-hugepages.mount dev-mqueue.mount sys-kernel-debug.mount sys-kernel-tracing.mount \
    sys-kernel-config.mount sys-fs-fuse-connections.mount systemd-update-utmp.service \
    cryptsetup.target remote-cryptsetup.target integritysetup.target veritysetup.target \
    systemd-firstboot.service systemd-update-done.service systemd-journal-catalog-update.service \
    systemd-ask-password-console.path systemd-ask-password-wall.path systemd-pstore.service \
    systemd-repart.service systemd-boot-system-token.service systemd-machine-id-commit.service \
    dbus.service dbus.socket; do
    ln -sf /dev/null "etc/systemd/system/$unit"
done
cat >etc/systemd/system/hil.target <<END
[Unit]
Requires=basic.target
Wants=hil.service
AllowIsolate=yes
END
cat >etc/systemd/system/hil.service <<END
[Unit]
After=basic.target systemd-udevd.service
Wants=systemd-udevd.service
SuccessAction=poweroff-force
FailureAction=poweroff-force
[Service]
Type=oneshot
Environment=HOME=/root
ExecStart=/bin/sh -c '/bin/sh "$HIL_JOB"; echo \$? >/out/status; sync'
StandardOutput=append:/out/job.log
StandardError=append:/out/job.log
END
exec chroot . /lib/systemd/systemd
