#!/bin/sh
# The Dockerfile's steps in an empty Debian, without Docker: does the image come about, and does a
# world run in it as nobody in particular, with a read-only root? As root, with debootstrap:
#
#     deploy/check_image.sh [FOLDER]
#
# FOLDER (default: a new one) needs a gigabyte. Debian's own Python stands in for the base image's.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
root=${1:-$(mktemp -d)}
test -d "$root/usr" || debootstrap --variant=minbase \
    --include=python3,python3-venv,ca-certificates bookworm "$root"

cleanup() { umount "$root/run" "$root/tmp" "$root/var/lib/minerva" "$root/dev/shm" \
    "$root/proc" 2>/dev/null || true; }
trap cleanup EXIT

echo "== build"
rm -rf "$root/src" "$root/opt/minerva"
mkdir -p "$root/src" "$root/proc" "$root/dev/shm" "$root/var/lib/minerva"
for one in pyproject.toml README.md LICENSE minerva_bus services agents; do
    cp -r "$here/$one" "$root/src/"
done
cp /etc/resolv.conf "$root/etc/resolv.conf"
certificates=/etc/ssl/certs/ca-certificates.crt # this machine's own: it may stand behind a proxy
for one in /etc/pip.conf $certificates; do test ! -f $one || cp $one "$root$one"; done
mount -t proc proc "$root/proc"
run() { chroot "$root" env -i PATH=/opt/minerva/bin:/usr/bin:/bin HOME=/nonexistent \
    PIP_CERT=$certificates "$@"; }
# The steps are those of the Dockerfile, word for word; only `python` has another name here.
ln -sf /usr/bin/python3 "$root/usr/bin/python"
sed -n '/^FROM/,$p' "$here/deploy/docker/Dockerfile" | python3 -c '
import re, sys
text = re.sub(r"\\\n", " ", sys.stdin.read())
for step in re.findall(r"^RUN (.*)$", text, re.M):
    print(re.sub(r" +", " ", step))
' > "$root/steps"
while read -r step; do
    echo "+ $step"
    run sh -c "cd /src && $step" < /dev/null
done < "$root/steps"
du -sh "$root/opt/minerva"

echo "== a world as user 10001 with a read-only root"
mount --bind "$root" "$root/mnt" && mount -o remount,ro,bind "$root/mnt"
trap 'umount "$root/mnt/run" "$root/mnt/tmp" "$root/mnt/var/lib/minerva" "$root/mnt/dev/shm" \
    "$root/mnt/proc" "$root/mnt" 2>/dev/null || true; cleanup' EXIT
mount -t proc proc "$root/mnt/proc"
for place in run tmp var/lib/minerva; do mount -t tmpfs -o mode=1777 tmpfs "$root/mnt/$place"; done
mkdir -m 1777 "$root/mnt/run/minerva"
chroot --userspec=10001:10001 "$root/mnt" env -i PATH=/opt/minerva/bin:/usr/bin:/bin \
    MINERVA_RUNTIME_DIR=/run/minerva/here PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1 sh -eu -c '
    cd /var/lib/minerva
    touch /usr/no 2>/dev/null && { echo "the root can be written"; exit 1; }
    minerva keys init --dir keys --host localhost
    minerva run robot --until= --frames 60 --listen tls/127.0.0.1:7447 --keys keys \
        --journal journal --metrics 127.0.0.1:9464 --log-format json > summary & world=$!
    for n in $(seq 100); do
        python3 -c "import urllib.request as u; u.urlopen(\"http://127.0.0.1:9464/ready\")" \
            2>/dev/null && break
        sleep 0.1
    done
    python3 -c "import urllib.request as u; print(u.urlopen(\"http://127.0.0.1:9464/ready\").read())"
    wait $world
    cat summary
    ls'
echo "== well"
