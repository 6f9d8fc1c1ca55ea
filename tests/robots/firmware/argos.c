/* What IRIDIA's epuck_firmware.c calls and does not bring: converter, radio and infrared.
 *
 * Converter and battery pin are what the test has written into the shared page (page.h). Functions
 * that have nothing to do are added when it is linked. */
#include "motor_led/e_epuck_ports.h"

#include "ircom.h"
#include "leds_on.h"
#include "page.h"

void _T2Interrupt(void);
int e_get_steps_left(void);
int e_get_steps_right(void);

int e_get_prox(int sensor)
{
    _RF1 = page->battery_good;
    return page->proximity[sensor];
}

int e_get_ambient_light(int sensor) { return page->light[sensor]; }

int e_getchar_uart2(char *c) { return uart_get(c); }

void e_send_uart2_char(const char *bytes, int length) { uart_put(bytes, length); }

void ircomPopMessage(IrcomMessage *message)
{
    memset(message, 0, sizeof *message);
    message->error = 1; /* none has come */
}

int ircomSendDone(void) { return 1; }
void e_randb_send_all_data(unsigned int data) { page->radio_sent = (int)data + 1; }
void e_init_uart2(void) { uart_flush(); }

void e_init_randb(unsigned char mode)
{
    (void)mode;
    page->radio_inits++;
}

void chip_tick(void)
{
    if (IEC0bits.T2IE && T2CONbits.TON)
        _T2Interrupt();
}

void chip_shows(struct page *shown)
{
    shown->left_steps = e_get_steps_left();
    shown->right_steps = e_get_steps_right();
    shown->leds = leds_on();
}
