#!/bin/bash
# A computer of its own for a real systemd: namespaces, an overlay over this computer's files, empty /run, /tmp and /dev.
# Called in new mount, pid, network, host name, ipc and cgroup namespaces: systemd_box.sh SHARED BOUND=PLACE...
#   SHARED  a folder that is /box inside; each BOUND folder is seen read-only at PLACE.
set -e
shared=$1
shift
base=/mnt
mount -t tmpfs tmpfs $base
mkdir -p $base/up $base/work $base/root
root=$base/root
mount -t overlay overlay -o lowerdir=/,upperdir=$base/up,workdir=$base/work $root
mkdir -p $root/box
mount --bind "$shared" $root/box
for pair in "$@"; do
    mkdir -p "$root${pair#*=}"
    mount --bind -o ro "${pair%%=*}" "$root${pair#*=}"
done
mount -t tmpfs -o mode=755 tmpfs $root/run
mkdir -p $root/run/lock
chmod 1777 $root/run/lock
mount -t tmpfs -o mode=1777 tmpfs $root/tmp
mount -t proc proc $root/proc
mount -t sysfs -o ro sysfs $root/sys
mount -t cgroup2 cgroup2 $root/sys/fs/cgroup
mount -t tmpfs -o mode=755 tmpfs $root/dev
while read -r name major minor; do
    mknod -m 666 "$root/dev/$name" c "$major" "$minor"
done <<DEVICES
null 1 3
zero 1 5
full 1 7
random 1 8
urandom 1 9
tty 5 0
DEVICES
mkdir $root/dev/pts $root/dev/shm
mount -t devpts -o newinstance,ptmxmode=0666,mode=0666 devpts $root/dev/pts
ln -s pts/ptmx $root/dev/ptmx
ln -s /proc/self/fd $root/dev/fd
mount -t tmpfs -o mode=1777 tmpfs $root/dev/shm
rm -rf $root/etc/systemd/system/*.wants $root/var/log/journal
echo 0123456789abcdef0123456789abcdef > $root/etc/machine-id
printf '[Unit]\nRequires=systemd-journald.service\nAfter=systemd-journald.service\n' \
    > $root/etc/systemd/system/box.target
cd $root
mkdir -p .old
pivot_root . .old
umount -l /.old
ip link set lo up
export container=box
exec /lib/systemd/systemd --system --unit=box.target --log-target=journal --show-status=no
