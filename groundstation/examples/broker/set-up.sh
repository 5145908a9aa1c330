#!/bin/sh
# Makes all that a mosquitto broker for a laboratory needs, in a new folder: its own authority and certificate, passwords,
# access rules. Then: mosquitto -c FOLDER/mosquitto.conf
# In a folder that it has made before, it adds what is missing: a certificate for another HOST by the same authority, and
# passwords of further VEHICLES. All others stay as they are.
#
#   set-up.sh FOLDER [HOST [PORT]]      HOST as stations will call it (default localhost), PORT 8883
#
# Users: each station logs in by its vehicle's name; VEHICLES="mqx quad2" makes them (default: mqx). `viewer` reads all,
# `operator` also asks. Passwords are in FOLDER/password-USER, keys in FOLDER: for your eyes only.
set -eu
umask 077
folder=${1:?usage: set-up.sh FOLDER [HOST [PORT]]}
host=${2:-}
port=${3:-}
for program in openssl mosquitto_passwd; do
    command -v "$program" >/dev/null || { echo "set-up.sh: install $program first" >&2; exit 1; }
done
if [ -f "$folder/ca.key" ] && [ -f "$folder/mosquitto.conf" ]; then
    made=yes
    port=${port:-$(sed -n 's/^listener \([0-9]*\).*/\1/p' "$folder/mosquitto.conf")}
else
    made=
    mkdir "$folder" || { echo "set-up.sh: $folder must be new" >&2; exit 1; }
    host=${host:-localhost}
    port=${port:-8883}
fi
folder=$(cd "$folder" && pwd)
case $host in
    *[!0-9.:]*) name="DNS:$host" check=-checkhost ;;
    *) name="IP:$host" check=-checkip ;;
esac
case $host in
    localhost | 127.* | ::1) listen="$port 127.0.0.1" ;;
    *) listen="$port" ;;
esac

key() { openssl ecparam -name prime256v1 -genkey -noout -out "$1"; }
certify() { # the broker's own certificate, for $name
    key "$folder/broker.key"
    openssl req -new -key "$folder/broker.key" -subj "/CN=$host" -out "$folder/broker.csr" 2>/dev/null
    printf 'subjectAltName=%s,DNS:localhost,IP:127.0.0.1\nextendedKeyUsage=serverAuth\nauthorityKeyIdentifier=keyid\n' \
        "$name" >"$folder/broker.ext"
    openssl x509 -req -in "$folder/broker.csr" -CA "$folder/ca.crt" -CAkey "$folder/ca.key" \
        -set_serial "0x$(openssl rand -hex 8)" -days 1825 -extfile "$folder/broker.ext" -out "$folder/broker.crt" 2>/dev/null
    rm "$folder/broker.csr" "$folder/broker.ext"
}
add_user() {
    openssl rand -hex 16 >"$folder/password-$1"
    mosquitto_passwd -b "$folder/passwords" "$1" "$(cat "$folder/password-$1")"
}

if [ "$made" ]; then
    if [ "$host" ] && ! openssl x509 -in "$folder/broker.crt" -noout "$check" "$host" | grep -q "does match"; then
        certify
        echo "a new certificate for $host, by the same authority: clients keep their ca.crt"
    fi
    if [ "$host" ]; then
        sed "s/^listener .*/listener $listen/" "$folder/mosquitto.conf" >"$folder/mosquitto.conf.new"
        mv "$folder/mosquitto.conf.new" "$folder/mosquitto.conf"
    fi
    for user in ${VEHICLES:-}; do
        [ -f "$folder/password-$user" ] || { add_user "$user"; echo "a password for $user"; }
    done
    echo "mosquitto -c $folder/mosquitto.conf"
    exit 0
fi

key "$folder/ca.key"
openssl req -x509 -new -key "$folder/ca.key" -days 3650 -subj "/CN=groundstation broker authority" \
    -addext "keyUsage=critical,keyCertSign" -out "$folder/ca.crt" 2>/dev/null
certify
: >"$folder/passwords"
for user in ${VEHICLES:-mqx} viewer operator; do
    add_user "$user"
done

cat >"$folder/access" <<EOF
# A station writes below its own vehicle, and reads what is asked of it.
pattern write groundstation/%u/#
pattern read groundstation/%u/request

user viewer
topic read groundstation/#

# To be obeyed takes more: a client of mqtt.requests, and its key.
user operator
topic read groundstation/#
topic write groundstation/+/request
EOF

cat >"$folder/mosquitto.conf" <<EOF
user $(id -un)
per_listener_settings false
listener $listen
certfile $folder/broker.crt
keyfile $folder/broker.key
tls_version tlsv1.2
allow_anonymous false
password_file $folder/passwords
acl_file $folder/access
# Nothing is kept for who is away, and nobody keeps the broker busy for long.
persistence false
set_tcp_nodelay true
max_queued_messages 200
max_packet_size 65536
EOF
chmod 644 "$folder/ca.crt"
echo "mosquitto -c $folder/mosquitto.conf"
echo "to every station and client goes $folder/ca.crt; keep ca.key away from all of them"
