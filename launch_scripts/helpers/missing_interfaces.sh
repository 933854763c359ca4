# Sourced by build_messages.sh.

# missing_interfaces VENV WHEEL_ONLY: the packages of the folder WHEEL_ONLY that an environment lacks, or
# has from that folder, one a line; what ROS or the user brought is left alone.
missing_interfaces() {
    local folder there
    for folder in "$2"/*/; do
        folder=${folder%/}
        there=$1/share/${folder##*/}/package.xml
        if [ ! -e "$there" ] || cmp -s "$there" "$folder/package.xml"; then
            echo "${folder##*/}"
        fi
    done
}
