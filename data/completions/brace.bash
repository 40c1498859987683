# SPDX-License-Identifier: Apache-2.0
# bash completion for brace

_brace()
{
    local cur prev command
    COMPREPLY=()
    cur=${COMP_WORDS[COMP_CWORD]}
    prev=${COMP_WORDS[COMP_CWORD - 1]}
    local raw='@(dng|DNG|3fr|3FR|arw|ARW|cr2|CR2|cr3|CR3|crw|CRW|nef|NEF|nrw|NRW|orf|ORF|pef|PEF|raf|RAF|raw|RAW|rw2|RW2|rwl|RWL|srw|SRW)'

    if [[ $COMP_CWORD -eq 1 ]]; then
        mapfile -t COMPREPLY < <(compgen -W 'restore info analyze metrics simulate dataset train eval model capture bench help --help --version' -- "$cur")
        return
    fi
    command=${COMP_WORDS[1]}
    if [[ $command == help ]]; then
        mapfile -t COMPREPLY < <(compgen -W 'restore info analyze metrics simulate dataset train eval model capture bench' -- "$cur")
        return
    fi

    if [[ $command == simulate ]]; then
        if [[ $cur == -* ]]; then
            mapfile -t COMPREPLY < <(compgen -W '--output --sheet --explain --list --display --camera --size --count --seed
                --time --iso --level --distance --set --off --scene --field --threads --quiet --help' -- "$cur")
        elif [[ ${COMP_WORDS[COMP_CWORD - 1]} == --off ]]; then
            mapfile -t COMPREPLY < <(compgen -W 'pose tremor distortion psf defocus glare vignetting ambient clutter
                nonuniformity noise all' -- "$cur")
        elif [[ ${COMP_WORDS[COMP_CWORD - 1]} == --set ]]; then
            compopt -o nospace
            mapfile -t COMPREPLY < <(compgen -S = -W "$(brace simulate --list 2>/dev/null | awk 'seen { print $1 } $1 == "NAME" { seen = 1 }')" -- "$cur")
        else
            compopt -o filenames
            mapfile -t COMPREPLY < <(compgen -f -- "$cur")
        fi
        return
    fi

    if [[ $command == metrics ]]; then
        case $prev in
            -m | --metrics) mapfile -t COMPREPLY < <(compgen -W 'psnr ssim ms-swd sfc lpips lpips-alex lpips-vgg
                lpips-squeeze dists' -- "$cur"); return ;;
            -w | --weights) compopt -o filenames; mapfile -t COMPREPLY < <(compgen -d -- "$cur"); return ;;
            -t | --threads | --html-side) return ;;
        esac
        if [[ $cur == -* ]]; then
            mapfile -t COMPREPLY < <(compgen -W '--metrics --bracket --weights --csv --html --html-side --json --threads --quiet --help' -- "$cur")
        else
            compopt -o filenames
            mapfile -t COMPREPLY < <(compgen -f -- "$cur")
        fi
        return
    fi

    if [[ $command == dataset ]]; then
        if [[ $COMP_CWORD -eq 2 ]]; then
            mapfile -t COMPREPLY < <(compgen -W 'build pack verify info import --help' -- "$cur")
        elif [[ $prev == --only ]]; then
            mapfile -t COMPREPLY < <(compgen -W 'train test' -- "$cur")
        elif [[ $cur == -* ]]; then
            local dataset_options='--json --quiet --threads --help'
            case ${COMP_WORDS[2]} in
                pack) dataset_options+=' --output --shard-size' ;;
                import) dataset_options+=' --output --reduce --tolerance' ;;
                build) dataset_options+=' --output --screens --priors --seed --train --test --size --only --shard --field' ;;
            esac
            mapfile -t COMPREPLY < <(compgen -W "$dataset_options" -- "$cur")
        else
            compopt -o filenames
            mapfile -t COMPREPLY < <(compgen -d -- "$cur")
        fi
        return
    fi

    if [[ $command == model ]]; then
        if [[ $prev == --type ]]; then
            mapfile -t COMPREPLY < <(compgen -W 'f32 f16 bf16' -- "$cur")
        elif [[ $prev == --network ]]; then
            mapfile -t COMPREPLY < <(compgen -W 'brace brace-s tmrnet tmrnet-s' -- "$cur")
        elif [[ $cur == -* ]]; then
            mapfile -t COMPREPLY < <(compgen -W '--output --type --network --json --help' -- "$cur")
        else
            compopt -o filenames
            mapfile -t COMPREPLY < <(compgen -f -- "$cur")
        fi
        return
    fi

    if [[ $command == train || $command == eval ]]; then
        if [[ $cur == -* && $command == train ]]; then
            mapfile -t COMPREPLY < <(compgen -W '--output --resume --threads --json --quiet --help' -- "$cur")
        elif [[ $cur == -* ]]; then
            mapfile -t COMPREPLY < <(compgen -W '--data --method --count --weights --csv --html --sheet --scenes --sheet-side
                --memory --precision --json --threads --quiet --help' -- "$cur")
        elif [[ $prev == --precision ]]; then
            mapfile -t COMPREPLY < <(compgen -W 'f32 bf16' -- "$cur")
        else
            compopt -o filenames
            mapfile -t COMPREPLY < <(compgen -f -- "$cur")
        fi
        return
    fi
    if [[ $command == capture ]]; then
        if [[ $COMP_CWORD -eq 2 ]]; then
            mapfile -t COMPREPLY < <(compgen -W 'list plan run check --help' -- "$cur")
        elif [[ $prev == --camera || $prev == -c ]]; then
            mapfile -t COMPREPLY < <(compgen -W "$(brace capture list 2>/dev/null | sed -n 's/^  --camera \([^ ]*\).*/\1/p')" -- "$cur")
        elif [[ $cur == -* ]]; then
            local capture_options='--json --quiet --threads --help'
            local capture_plan=' --camera --option --time --iso --frames --step --no-truth --shots'
            case ${COMP_WORDS[2]} in
                list) capture_options+=' --camera --option' ;;
                plan) capture_options+="$capture_plan --flicker" ;;
                run) capture_options+="$capture_plan --output --repeat --resume --restart --tries --accept --fault" ;;
            esac
            mapfile -t COMPREPLY < <(compgen -W "$capture_options" -- "$cur")
        else
            compopt -o filenames
            mapfile -t COMPREPLY < <(compgen -d -- "$cur")
        fi
        return
    fi

    if [[ $command == bench ]]; then
        if [[ $COMP_CWORD -eq 2 ]]; then
            mapfile -t COMPREPLY < <(compgen -W 'sim conv model --help' -- "$cur")
        elif [[ $cur == -* ]]; then
            mapfile -t COMPREPLY < <(compgen -W '--display --camera --channels --blocks --network --layers --size --recompute --hand --quick --threads --json --quiet --help' -- "$cur")
        else
            compopt -o filenames
            mapfile -t COMPREPLY < <(compgen -f -- "$cur")
        fi
        return
    fi

    # In bash, "--method=merge" arrives as three words.
    if [[ $cur == '=' ]]; then
        cur=
    elif [[ $prev == '=' && $COMP_CWORD -gt 2 ]]; then
        prev=${COMP_WORDS[COMP_CWORD - 2]}
    fi

    case $prev in
        -c | --camera | -p | --plot) compopt -o filenames; mapfile -t COMPREPLY < <(compgen -f -- "$cur"); return ;;
        --readout) return ;;
        -m | --method) mapfile -t COMPREPLY < <(compgen -W 'brace merge reference' -- "$cur"); return ;;
        -f | --format) mapfile -t COMPREPLY < <(compgen -W 'dng tif png jpg webp' -- "$cur"); return ;;
        --bits) mapfile -t COMPREPLY < <(compgen -W '8 16 32' -- "$cur"); return ;;
        --precision) mapfile -t COMPREPLY < <(compgen -W 'f32 bf16' -- "$cur"); return ;;
        --model) compopt -o filenames; mapfile -t COMPREPLY < <(compgen -W 'brace-s tmrnet-s brace tmrnet' -- "$cur"; compgen -f -- "$cur"); return ;;
        -o | --output | --report | --truth) compopt -o filenames; mapfile -t COMPREPLY < <(compgen -f -- "$cur"); return ;;
        --memory | --quality | --exposure | --exposures | --report-side | -t | --threads) return ;;
        -r | --reference) ;;
        *)
            if [[ $cur == -* ]]; then
                local options='--json --quiet --threads --help'
                if [[ $command == restore ]]; then
                    options+=' --output --format --bits --quality --exposure --reference --exposures --method'
                    options+=' --no-align --verbose --report --report-side --truth --model --memory --precision'
                fi
                [[ $command != analyze ]] || options+=' --readout --camera --plot --no-align'
                mapfile -t COMPREPLY < <(compgen -W "$options" -- "$cur")
                return
            fi
            ;;
    esac

    # RAW files, and folders on the way to them.
    local restore_extglob
    restore_extglob=$(shopt -p extglob)
    shopt -s extglob
    compopt -o filenames
    mapfile -t COMPREPLY < <(compgen -f -X "!*.$raw" -- "$cur"; compgen -d -- "$cur")
    $restore_extglob
}
complete -F _brace brace
