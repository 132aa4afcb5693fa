/* Texts, numbers in them, and the log. */

static Text text_in(char *room, size_t size) {
    Text text = {room, size, 0, 0};
    room[0] = '\0';
    return text;
}

/* Ends a text that is too long; characters of several bytes stay whole. */
static void text_cut(Text *text) {
    while (text->length > 0 && ((unsigned char)text->at[text->length - 1] & 0xC0) == 0x80) {
        text->length--;
    }
    if (text->length > 0 && (unsigned char)text->at[text->length - 1] >= 0xC0) {
        text->length--;
    }
    memcpy(text->at + text->length, "\xE2\x80\xA6", 4);
    text->length += 3;
    text->is_cut = 1;
}

static void text_bytes(Text *text, const char *bytes, size_t count) {
    if (text->is_cut) {
        return;
    }
    /* The ellipsis and the end find room always. */
    if (text->length + count + 4 > text->room) {
        text_cut(text);
        return;
    }
    memcpy(text->at + text->length, bytes, count);
    text->length += count;
    text->at[text->length] = '\0';
}

static void text_character(Text *text, char c) {
    static const char hexadecimal[] = "0123456789abcdef";
    unsigned char byte = (unsigned char)c;
    char escaped[] = {'\\', 'u', '{', hexadecimal[byte / 16], hexadecimal[byte % 16], '}'};
    if (c == '%' && UNIT_FMI == 2) {
        text_bytes(text, "%%", 2);
    } else if (c == '\n' || c == '\r' || c == '\t') {
        text_bytes(text, c == '\n' ? "\\n" : c == '\r' ? "\\r" : "\\t", 2);
    } else if (byte < 0x20 || byte == 0x7F) {
        text_bytes(text, escaped, sizeof escaped);
    } else {
        text_bytes(text, &c, 1);
    }
}

static void text_add(Text *text, const char *part) {
    for (; *part != '\0' && !text->is_cut; part++) {
        text_character(text, *part);
    }
}

static void text_integer(Text *text, long long value) {
    char digits[24];
    int at = (int)sizeof digits;
    unsigned long long rest = value < 0 ? 0ULL - (unsigned long long)value : (unsigned long long)value;
    do {
        digits[--at] = (char)('0' + (int)(rest % 10));
        rest /= 10;
    } while (rest > 0);
    if (value < 0) {
        digits[--at] = '-';
    }
    text_bytes(text, digits + at, sizeof digits - (size_t)at);
}

/* Digits with the point in its place, and so many behind it. */
static void text_written_out(Text *text, const Decimal *d, int behind) {
    if (d->power < 1) {
        text_bytes(text, "0", 1);
    }
    for (int place = 0; place < d->power; place++) {
        text_bytes(text, place < d->count ? &d->digits[place] : "0", 1);
    }
    for (int k = 0; k < behind; k++) {
        int place = d->power + k;
        text_bytes(text, k == 0 ? "." : "", k == 0);
        text_bytes(text, place < 0 || place >= d->count ? "0" : &d->digits[place], 1);
    }
}

static void text_with_exponent(Text *text, const Decimal *d) {
    text_bytes(text, d->digits, 1);
    if (d->count > 1) {
        text_bytes(text, ".", 1);
        text_bytes(text, d->digits + 1, (size_t)d->count - 1);
    }
    text_bytes(text, "e", 1);
    text_integer(text, d->power - 1);
}

/* Writes the sign and what has no digits; whether there are digits to write. Zero has no sign where it is `plain`. */
static int text_has_digits(Text *text, real value, int plain) {
    if (isnan(value)) {
        text_add(text, "NaN");
        return 0;
    }
    if (signbit(value) && !(plain && value == 0)) {
        text_bytes(text, "-", 1);
    }
    if (isinf(value)) {
        text_add(text, "inf");
        return 0;
    }
    return 1;
}

static void text_number(Text *text, real value) {
    real size = F(fabs)(value);
    if (!text_has_digits(text, value, 1)) {
        return;
    }
    if (size == 0) {
        text_bytes(text, "0", 1);
        return;
    }
    Decimal d;
    decimal_shortest(&d, size);
    if (size >= R(1e-4) && size < R(1e9)) {
        text_written_out(text, &d, d.count - d.power);
    } else {
        text_with_exponent(text, &d);
    }
}

static void text_scientific(Text *text, real value) {
    Decimal d = {"0", 1, 1};
    if (text_has_digits(text, value, 0)) {
        if (value != 0) {
            decimal_shortest(&d, F(fabs)(value));
        }
        text_with_exponent(text, &d);
    }
}

/* So many digits behind the point, with an exponent, rounded (e) or cut (c), or without (f). */
static void text_with_digits(Text *text, real value, char form, int digits) {
    if (!text_has_digits(text, value, 0)) {
        return;
    }
    Decimal d;
    d.count = form == 'f' ? 0 : digits + 1;
    d.power = form == 'f' ? 0 : 1;
    memset(d.digits, '0', sizeof d.digits);
    if (value != 0 && form == 'c') {
        decimal_cut(&d, F(fabs)(value), digits + 1, 0);
    } else if (value != 0) {
        decimal_exact(&d, F(fabs)(value), form == 'f' ? digits : digits + 1, form == 'f');
    } else {
        /* Zero has its digits. */
    }
    if (form == 'f') {
        text_written_out(text, &d, digits);
    } else {
        text_with_exponent(text, &d);
    }
}

/* Seven digits, as short as can be: rounded (r), cut (d), or rounded up (u). */
static void text_rounded(Text *text, real value, char form) {
    if (!text_has_digits(text, value, 1)) {
        return;
    }
    if (value == 0) {
        text_bytes(text, "0", 1);
        return;
    }
    Decimal d;
    if (form == 'r') {
        decimal_exact(&d, F(fabs)(value), 7, 0);
    } else {
        decimal_cut(&d, F(fabs)(value), 7, form == 'u');
    }
    while (d.count > 1 && d.digits[d.count - 1] == '0') {
        d.count--;
    }
    if (d.power >= -2 && d.power <= 6) {
        text_written_out(text, &d, d.count - d.power);
    } else {
        text_with_exponent(text, &d);
    }
}

static void text_marked(Text *text, const char *marked, const real *values, int count) {
    int next = 0;
    while (*marked != '\0') {
        if (*marked != '\1') {
            text_character(text, *marked);
            marked++;
            continue;
        }
        const char form = marked[1];
        real value = next < count ? values[next] : 0;
        next++;
        marked += 2;
        if (form == 'n') {
            text_number(text, value);
        } else if (form == 'r' || form == 'd' || form == 'u') {
            text_rounded(text, value, form);
        } else {
            text_with_digits(text, value, form, *marked - '0');
            marked++;
        }
    }
}

static void fill(Message *message, const char *text, const real *values, int count) {
    message->text = text;
    message->count = count < MOST_VALUES ? count : MOST_VALUES;
    for (int k = 0; k < message->count; k++) {
        message->values[k] = values[k];
    }
}

static void log_text(Log *log, int category, const char *text, const real *values, int count) {
    if (log->count == MOST_WAITING) {
        log->left_out++;
        return;
    }
    log->waiting[log->count].category = category;
    fill(&log->waiting[log->count++], text, values, count);
}

static void tell_before(Log *log, int place, int category, const char *text, const real *values, int count) {
    int at = log->count;
    if (at == MOST_WAITING) {
        log->left_out++;
        at--;
    }
    log->count = at + 1;
    for (; at > place; at--) {
        log->waiting[at] = log->waiting[at - 1];
    }
    log->waiting[at].category = category;
    fill(&log->waiting[at], text, values, count);
}

static LogPlace log_place(const Log *log) {
    LogPlace place = {log->count, log->left_out};
    return place;
}

static void log_take_back(Log *log, LogPlace place) {
    log->count = place.count;
    log->left_out = place.left_out;
}

static void refuse(Log *log, const char *reason, const real *values, int count) {
    if (log->refused++ < MOST_REASONS) {
        log->reasons[log->refused - 1].name = NULL;
        fill(&log->reasons[log->refused - 1], reason, values, count);
    }
}

static void refuse_value(Log *log, const char *name, const char *reason, const real *values, int count) {
    refuse(log, reason, values, count);
    if (log->refused <= MOST_REASONS) {
        log->reasons[log->refused - 1].name = name;
    }
}

static int log_refused(const Log *log) {
    return log->refused;
}

static void log_take_refusals(Log *log, Text *text, const real *time) {
    int told = log->refused < MOST_REASONS ? log->refused : MOST_REASONS;
    for (int k = 0; k < told; k++) {
        const Message *reason = &log->reasons[k];
        text_add(text, k > 0 ? "; " : "");
        text_add(text, reason->name != NULL ? reason->name : "");
        text_add(text, reason->name != NULL ? " = " : "");
        text_marked(text, reason->text, reason->values, reason->count);
        if (time != NULL) {
            text_marked(text, " (at t = \1n s)", time, 1);
        }
    }
    if (log->refused > told) {
        text_add(text, "; and ");
        text_integer(text, log->refused - told);
        text_add(text, " more");
    }
    log->refused = 0;
}
